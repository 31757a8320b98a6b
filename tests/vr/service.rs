//! Processes of a run: the runtime's service, an X server for its window, and the program itself.

use std::net::TcpListener;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

/// What scripts/test-vr has exported.
fn exported(name: &str) -> String {
    std::env::var(name).unwrap_or_else(|_| panic!("{name} is not set: scripts/test-vr sets it"))
}

/// A command behind the words that the unpacked runtime's programs need in front, if any.
fn behind_prefix(program: &str) -> Command {
    let prefix = exported("INCISE_XR_PREFIX");
    let mut words = prefix.split_whitespace().chain([program]);
    let mut command = Command::new(words.next().expect("at least the program"));
    command.args(words);
    command
}

/// A child that does not outlive the test. Asked to end first, then made to.
struct Kept(Child);

impl Kept {
    fn spawn(command: &mut Command) -> Self {
        Self(command.stdin(Stdio::null()).spawn().expect("it starts"))
    }

    fn end(&mut self) {
        let id = self.0.id().to_string();
        let _ = Command::new("kill").arg(&id).stderr(Stdio::null()).status();
        if !within(Duration::from_secs(2), || matches!(self.0.try_wait(), Ok(Some(_)))) {
            let _ = self.0.kill();
        }
        let _ = self.0.wait();
    }
}

impl Drop for Kept {
    fn drop(&mut self) {
        self.end();
    }
}

/// Looks until it is so, or the time is over.
pub fn within(time: Duration, mut so: impl FnMut() -> bool) -> bool {
    let start = Instant::now();
    while start.elapsed() < time {
        if so() {
            return true;
        }
        std::thread::sleep(Duration::from_millis(20));
    }
    so()
}

/// How the runtime composes pictures.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Compositor {
    /// Not at all, 20 times a second.
    Null,
    /// Into a window of an X server of its own.
    Window,
}

/// A runtime with a scripted headset, in a folder of its own.
pub struct Service {
    // In the order to end them: the service goes first, or it hangs for want of its X server.
    monado: Option<Kept>,
    x_server: Option<Kept>,
    pub folder: PathBuf,
    pub port: u16,
    compositor: Compositor,
}

impl Service {
    /// A folder without a service in it.
    pub fn absent(name: &str) -> Self {
        // Sockets have short names, so not below target/.
        let folder = std::env::temp_dir().join(format!("incise-vr-{}-{name}", std::process::id()));
        let _ = std::fs::remove_dir_all(&folder);
        std::fs::create_dir_all(folder.join("config/monado")).expect("a folder");
        use std::os::unix::fs::PermissionsExt;
        std::fs::set_permissions(&folder, std::fs::Permissions::from_mode(0o700)).expect("ours alone");
        let port = TcpListener::bind("127.0.0.1:0").and_then(|l| l.local_addr()).expect("a free port").port();
        Self { monado: None, x_server: None, folder, port, compositor: Compositor::Null }
    }

    /// Starts a service and waits until it answers.
    pub fn start(name: &str, compositor: Compositor) -> Self {
        let mut service = Self::absent(name);
        service.compositor = compositor;
        if compositor == Compositor::Window {
            service.start_x_server();
        }
        service.start_monado();
        service
    }

    fn display(&self) -> String {
        format!(":{}", 100 + self.port % 800)
    }

    fn start_x_server(&mut self) {
        let mut command = Command::new("Xvfb");
        command.arg(self.display()).args(["-screen", "0", "960x540x24", "-nolisten", "tcp", "-fbdir"]).arg(&self.folder);
        self.x_server = Some(Kept::spawn(command.stdout(Stdio::null()).stderr(Stdio::null())));
        let socket = format!("/tmp/.X11-unix/X{}", &self.display()[1..]);
        assert!(within(Duration::from_secs(10), || Path::new(&socket).exists()), "Xvfb does not start");
    }

    /// Starts the service, anew after [`Service::kill`].
    pub fn start_monado(&mut self) {
        let settings = format!(r#"{{"active":"remote","remote":{{"version":0,"port":{},"view_count":2}}}}"#, self.port);
        std::fs::write(self.folder.join("config/monado/config_v0.json"), settings).expect("written");
        let socket = self.folder.join("monado_comp_ipc");
        let _ = std::fs::remove_file(&socket);
        let mut command = behind_prefix(&exported("INCISE_XR_SERVICE"));
        self.environment(&mut command);
        command.env("XRT_NO_STDIN", "1").env("XRT_COMPOSITOR_SCALE_PERCENTAGE", "30");
        command.env_remove("VK_INSTANCE_LAYERS");
        match self.compositor {
            Compositor::Null => command.env("XRT_COMPOSITOR_NULL", "1"),
            Compositor::Window => command
                .env("XRT_COMPOSITOR_FORCE_XCB", "1")
                .env("DISPLAY", self.display())
                .env("XRT_COMPOSITOR_DEFAULT_FRAMERATE", "90"),
        };
        let log = std::fs::File::create(self.folder.join("service.log")).expect("a log");
        command.stdout(log.try_clone().expect("a log")).stderr(log);
        self.monado = Some(Kept::spawn(&mut command));
        assert!(within(Duration::from_secs(20), || socket.exists()), "no service: {}", self.log());
        std::thread::sleep(Duration::from_millis(300));
    }

    /// Ends the service at once, as a crash would.
    pub fn kill(&mut self) {
        if let Some(mut monado) = self.monado.take() {
            let _ = monado.0.kill();
            let _ = monado.0.wait();
        }
    }

    fn log(&self) -> String {
        std::fs::read_to_string(self.folder.join("service.log")).unwrap_or_default()
    }

    fn environment(&self, command: &mut Command) {
        command.env("XDG_RUNTIME_DIR", &self.folder).env("XDG_CONFIG_HOME", self.folder.join("config"));
    }

    /// `incise` with these arguments, in the runtime's folder.
    pub fn incise(&self, arguments: &[&str]) -> Command {
        let mut command = behind_prefix(env!("CARGO_BIN_EXE_incise"));
        self.environment(&mut command);
        let loader = Path::new(&exported("INCISE_XR_LOADER")).join("libopenxr_loader.so.1");
        command.env("INCISE_OPENXR_LOADER", loader).current_dir(&self.folder).args(arguments);
        command
    }

    /// True if the compositor shows its pictures.
    pub fn has_window(&self) -> bool {
        self.compositor == Compositor::Window
    }

    /// The X server's screen as it is now: RGB and its size.
    pub fn screen(&self) -> (Vec<u8>, u32, u32) {
        let bytes = std::fs::read(self.folder.join("Xvfb_screen0")).expect("the X server's picture");
        let word = |i: usize| u32::from_be_bytes(bytes[4 * i..4 * i + 4].try_into().expect("4 bytes"));
        // an X window dump: header size, then 4 width, 5 height, 12 bytes a line, 19 colours of 12 bytes each
        let (header, width, height, line, colours) = (word(0), word(4), word(5), word(12), word(19));
        let start = (header + 12 * colours) as usize;
        let row = |y: u32| &bytes[start + (y * line) as usize..][..4 * width as usize];
        let rgb = (0..height).flat_map(|y| row(y).chunks_exact(4).flat_map(|p| [p[2], p[1], p[0]])).collect();
        (rgb, width, height)
    }
}

impl Drop for Service {
    fn drop(&mut self) {
        self.monado = None;
        self.x_server = None;
        if !std::thread::panicking() {
            let _ = std::fs::remove_dir_all(&self.folder);
        }
    }
}

/// Runs it to its end.
pub fn finish(command: &mut Command) -> Output {
    command.stdin(Stdio::null()).output().expect("it starts")
}

/// What it said on stderr.
pub fn complaint(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}
