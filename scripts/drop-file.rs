//! Drags a file over an X11 window and drops it there, as a file manager does (XDND 5): `drop-file WINDOW X Y FILE`, the place in
//! pixels of the screen. It says "held" once the window has asked for the file's name, and then waits for a line: "drop" lets go
//! over the window, "leave" moves on. Ends with 0 when the window has answered. For scripts/test-desktop.

#[cfg(target_os = "linux")]
fn main() -> Result<(), Box<dyn std::error::Error>> {
    xdnd::run()
}

#[cfg(not(target_os = "linux"))]
fn main() {
    eprintln!("error: this is for X11");
    std::process::exit(2);
}

#[cfg(target_os = "linux")]
mod xdnd {
    use std::error::Error;
    use x11rb::connection::Connection;
    use x11rb::protocol::Event;
    use x11rb::protocol::xproto::{
        Atom, AtomEnum, ClientMessageEvent, ConnectionExt, CreateWindowAux, EventMask, PropMode, SELECTION_NOTIFY_EVENT,
        SelectionNotifyEvent, SelectionRequestEvent, Window, WindowClass,
    };
    use x11rb::rust_connection::RustConnection;
    use x11rb::wrapper::ConnectionExt as _;
    use x11rb::{COPY_DEPTH_FROM_PARENT, COPY_FROM_PARENT, CURRENT_TIME};

    type Outcome<T> = Result<T, Box<dyn Error>>;

    struct Drag {
        display: RustConnection,
        source: Window,
        target: Window,
    }

    pub fn run() -> Outcome<()> {
        let arguments: Vec<String> = std::env::args().skip(1).collect();
        let [target, x, y, file] = &arguments[..] else { return Err("usage: drop-file WINDOW X Y FILE".into()) };
        let (target, x, y): (Window, u32, u32) = (target.parse()?, x.parse()?, y.parse()?);
        let file = std::fs::canonicalize(file)?;
        let name = format!("file://{}\r\n", file.display());

        let (display, screen) = x11rb::connect(None)?;
        let root = display.setup().roots[screen].root;
        let source = display.generate_id()?;
        let (plain, kind) = (CreateWindowAux::new(), WindowClass::INPUT_OUTPUT);
        display.create_window(COPY_DEPTH_FROM_PARENT, source, root, 0, 0, 1, 1, 0, kind, COPY_FROM_PARENT, &plain)?;
        let drag = Drag { display, source, target };
        drag.check_aware()?;
        let (list, copy) = (drag.atom("text/uri-list")?, drag.atom("XdndActionCopy")?);
        drag.display.set_selection_owner(source, drag.atom("XdndSelection")?, CURRENT_TIME)?;
        drag.tell("XdndEnter", [5 << 24, list, 0, 0])?;
        drag.tell("XdndPosition", [0, x << 16 | y, CURRENT_TIME, copy])?;
        drag.serve(list, &name)?;
        println!("held");
        let mut line = String::new();
        std::io::stdin().read_line(&mut line)?;
        match line.trim() {
            "drop" => {
                drag.tell("XdndDrop", [0, CURRENT_TIME, 0, 0])?;
                drag.answer("XdndFinished")
            }
            "leave" => {
                drag.tell("XdndLeave", [0; 4])?;
                drag.display.sync().map_err(Into::into)
            }
            other => Err(format!("{other:?} is neither drop nor leave").into()),
        }
    }

    impl Drag {
        fn atom(&self, name: &str) -> Outcome<Atom> {
            Ok(self.display.intern_atom(false, name.as_bytes())?.reply()?.atom)
        }

        fn check_aware(&self) -> Outcome<()> {
            let aware = self.atom("XdndAware")?;
            let found = self.display.get_property(false, self.target, aware, AtomEnum::ANY, 0, 1)?.reply()?;
            if found.value_len == 0 { Err("the window takes no drops".into()) } else { Ok(()) }
        }

        fn tell(&self, what: &str, [a, b, c, d]: [u32; 4]) -> Outcome<()> {
            let event = ClientMessageEvent::new(32, self.target, self.atom(what)?, [self.source, a, b, c, d]);
            self.display.send_event(false, self.target, EventMask::NO_EVENT, event)?;
            Ok(self.display.flush()?)
        }

        /// Hands the name over when it is asked for, and waits until the window has also taken the drag.
        fn serve(&self, list: Atom, name: &str) -> Outcome<()> {
            let status = self.atom("XdndStatus")?;
            let (mut served, mut taken) = (false, false);
            while !(served && taken) {
                match self.display.wait_for_event()? {
                    Event::SelectionRequest(request) if request.target == list => {
                        self.hand_over(&request, name)?;
                        served = true;
                    }
                    Event::ClientMessage(event) if event.type_ == status => {
                        taken = event.data.as_data32()[1] & 1 == 1;
                        if !taken {
                            return Err("the window takes no files".into());
                        }
                    }
                    _ => {}
                }
            }
            Ok(())
        }

        fn hand_over(&self, request: &SelectionRequestEvent, name: &str) -> Outcome<()> {
            let SelectionRequestEvent { requestor, property, target, selection, time, .. } = *request;
            self.display.change_property8(PropMode::REPLACE, requestor, property, target, name.as_bytes())?;
            let response_type = SELECTION_NOTIFY_EVENT;
            let event = SelectionNotifyEvent { response_type, sequence: 0, time, requestor, selection, target, property };
            self.display.send_event(false, requestor, EventMask::NO_EVENT, event)?;
            Ok(self.display.flush()?)
        }

        fn answer(&self, what: &str) -> Outcome<()> {
            let wanted = self.atom(what)?;
            loop {
                match self.display.wait_for_event()? {
                    Event::ClientMessage(event) if event.type_ == wanted => return Ok(()),
                    _ => {}
                }
            }
        }
    }
}
