//! Leads a run in lockstep: moves the controllers, then tells the program what it should see.

use super::remote::{Controller, Remote};
use super::service::{HANG, Service, within};
use glam::{DQuat, DVec3};
use incise::host::vr::space::{Placement, Pose};
use serde_json::Value;
use std::io::{BufRead, BufReader, Write};
use std::net::{TcpListener, TcpStream};
use std::process::{Child, Stdio};

/// Where the user's head is.
pub const HEAD: [f32; 3] = [0.0, 1.6, 0.0];
/// From grip to tip, and how much deeper a full trigger is: the defaults of config.toml.
const TIP: f64 = 0.12;
const REACH: f64 = 0.03;

/// Metres: see [`Led::frame`].
const TICK: f32 = 1.0 / 1048576.0;

/// A program that is being led.
pub struct Led {
    program: Child,
    remote: Remote,
    lines: BufReader<TcpStream>,
    /// Where the model stands.
    pub placement: Placement,
    /// The model's bounds.
    pub low: DVec3,
    pub high: DVec3,
    /// How far the head looks down, radians.
    pub pitch: f32,
    /// What the GPU is to have taken for a frame, milliseconds; 0 leaves the pictures whole.
    pub gpu_ms: f64,
    /// False while a runtime's menu has the hands.
    pub focused: bool,
    hands: [Controller; 2],
    frames: usize,
}

impl Led {
    /// Starts the program with a heart at rest, whose report goes into `out`, and more arguments.
    pub fn heart(service: &Service, arguments: &[&str], more: &[(&str, &str)]) -> Self {
        Self::start(service, &[&["heart", "--animation", "none", "--out", "out"], arguments].concat(), more)
    }

    /// Starts the program with these arguments and waits until it has focus.
    pub fn start(service: &Service, arguments: &[&str], more: &[(&str, &str)]) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
        let address = listener.local_addr().expect("its address").to_string();
        let mut remote = connect(service);
        let away = Controller { position: [0.0, 1.0, 0.5], ..Controller::default() };
        remote.send(HEAD, 0.0, &[away; 2]).expect("the service takes it");
        let all = [&["vr"], arguments, &["--lockstep", &address]].concat();
        let mut command = service.incise(&all);
        for (name, value) in more {
            command.env(name, value);
        }
        let log = std::fs::File::create(service.folder.join("incise.log")).expect("a log");
        command.stdin(Stdio::null()).stdout(log.try_clone().expect("a log")).stderr(log);
        let program = command.spawn().expect("incise starts");
        let (stream, _) = listener.accept().expect("incise connects");
        stream.set_read_timeout(Some(HANG)).expect("a timeout");
        let mut led = Self {
            program,
            remote,
            lines: BufReader::new(stream),
            placement: Placement { position: DVec3::ZERO, yaw: 0.0, scale: 1.0 },
            low: DVec3::ZERO,
            high: DVec3::ZERO,
            pitch: 0.0,
            gpu_ms: 0.0,
            focused: true,
            hands: [away; 2],
            frames: 0,
        };
        let line = led.line();
        let ready = line.strip_prefix("ready ").unwrap_or_else(|| panic!("{line:?}\n{}", log_of(service)));
        let ready: Value = serde_json::from_str(ready).expect("JSON");
        let point = |v: &Value| DVec3::from_array([0, 1, 2].map(|i| v[i].as_f64().expect("a number")));
        (led.low, led.high) = (point(&ready["low"]), point(&ready["high"]));
        let head = Pose { position: DVec3::from_array(HEAD.map(f64::from)), rotation: DQuat::IDENTITY };
        led.placement = Placement::within_reach(led.low, led.high, &head);
        led
    }

    fn line(&mut self) -> String {
        let mut line = String::new();
        self.lines.read_line(&mut line).expect("incise answers");
        line.trim_end().to_string()
    }

    /// Turns a hand and puts the tip of its instrument, the trigger let go, at a point of model space.
    pub fn aim(&mut self, hand: usize, turn: [f32; 2], tip: DVec3) {
        self.hands[hand].turn = turn;
        let back = self.hands[hand].rotation() * DVec3::Z * TIP;
        self.hands[hand].position = (self.placement.to_world(tip) + back).as_vec3().to_array();
    }

    /// Puts the tip of a hand's instrument, the trigger let go, at a point of model space, pointing at a point of the room.
    pub fn point(&mut self, hand: usize, tip: DVec3, target: DVec3) {
        let way = (target - self.placement.to_world(tip)).normalize();
        self.aim(hand, [(-way.x).atan2(-way.z) as f32, (-way.y).asin() as f32], tip);
    }

    /// Where the grip of a level hand must be for the instrument's tip to be at a point of model space.
    pub fn grip_for(&self, tip: DVec3, trigger: f32) -> [f32; 3] {
        let deeper = TIP + REACH * f64::from(trigger);
        (self.placement.to_world(tip) + DVec3::Z * deeper).as_vec3().to_array()
    }

    /// Changes a hand for the frames to come.
    pub fn hand(&mut self, hand: usize) -> &mut Controller {
        &mut self.hands[hand]
    }

    /// Frames so far.
    pub fn frames(&self) -> usize {
        self.frames
    }

    /// One frame with the hands as they are.
    pub fn frame(&mut self, capture: bool) {
        self.frame_after(capture, || ());
    }

    /// The same; something is done while the program waits for the frame's input, which it sees in the next frame.
    pub fn frame_after(&mut self, capture: bool, meanwhile: impl FnOnce()) {
        self.asks();
        meanwhile();
        // No two packets that follow each other are alike, so that what the program sees is this one and its buttons.
        let mut hands = self.hands;
        hands[usize::from(hands[0].bare)].position[0] += TICK * (self.frames % 2) as f32;
        self.remote.send(HEAD, self.pitch, &hands).expect("the service takes it");
        let mut say = String::from("expect");
        for Controller { position: [x, y, z], trigger, squeeze, bare, .. } in hands {
            say += &if bare { " bare".into() } else { format!(" {x} {y} {z} {trigger} {squeeze}") };
        }
        self.say(&format!("{say} gpu {}{}", self.gpu_ms, if capture { " capture" } else { "" }));
    }

    /// Presses the lower button of a hand for two frames and lets it go for two.
    pub fn press_a(&mut self, hand: usize) {
        self.press(hand, |controller| &mut controller.a);
    }

    /// The same with the upper button.
    pub fn press_b(&mut self, hand: usize) {
        self.press(hand, |controller| &mut controller.b);
    }

    /// The same with the stick.
    pub fn press_stick(&mut self, hand: usize) {
        self.press(hand, |controller| &mut controller.stick_down);
    }

    fn press(&mut self, hand: usize, button: fn(&mut Controller) -> &mut bool) {
        for down in [true, true, false, false] {
            *button(self.hand(hand)) = down;
            self.frame(false);
        }
    }

    /// One frame in which nothing moves.
    pub fn pass(&mut self) {
        self.asks();
        self.say("pass");
    }

    /// The program asks for a frame's input: it has focus, or has not where that was taken, and the frame before is with the compositor.
    fn asks(&mut self) {
        let line = self.line();
        assert_eq!(line, format!("frame {}{}", self.frames, if self.focused { "" } else { " unfocused" }));
        self.frames += 1;
    }

    fn say(&mut self, line: &str) {
        self.lines.get_mut().write_all(format!("{line}\n").as_bytes()).expect("incise listens");
    }

    /// Ends the run, which must go well, and reads the report that it leaves in `out`.
    pub fn report(self, service: &Service) -> Value {
        assert!(self.quit(), "a clean exit: {}", log_of(service));
        let report = std::fs::read_to_string(service.folder.join("out/report.json")).expect("a report");
        serde_json::from_str(&report).expect("JSON")
    }

    /// Ends the run; true if the program left with exit code 0.
    pub fn quit(mut self) -> bool {
        self.line();
        self.say("quit");
        self.ends_well()
    }

    /// Reads and writes of files so far by the program's first thread, whose work the frames are; what goes through sockets does
    /// not count, nor do the threads of a driver.
    pub fn file_calls(&self) -> u64 {
        let thread = self.program.id();
        let io = std::fs::read_to_string(format!("/proc/{thread}/task/{thread}/io")).expect("a thread has this file");
        let count = |name: &str| io.lines().find_map(|l| l.strip_prefix(name)).and_then(|n| n.trim().parse::<u64>().ok());
        count("syscr:").expect("reads") + count("syscw:").expect("writes")
    }

    /// Waits for the program's end; true if it left with exit code 0.
    pub fn ends_well(mut self) -> bool {
        let mut code = None;
        within(HANG, || {
            code = self.program.try_wait().ok().flatten();
            code.is_some()
        });
        code.is_some_and(|c| c.success())
    }

    /// Leads on after the service was started anew.
    pub fn reconnect(&mut self, service: &Service) {
        self.remote = connect(service);
        self.remote.send(HEAD, self.pitch, &self.hands).expect("the service takes it");
    }
}

impl Drop for Led {
    fn drop(&mut self) {
        let _ = self.program.kill();
        let _ = self.program.wait();
    }
}

fn connect(service: &Service) -> Remote {
    let mut remote = None;
    within(HANG, || {
        remote = Remote::connect(service.port).ok();
        remote.is_some()
    });
    remote.expect("the remote driver answers")
}

/// What the program has said so far, on stdout and stderr.
pub fn log_of(service: &Service) -> String {
    std::fs::read_to_string(service.folder.join("incise.log")).unwrap_or_default()
}
