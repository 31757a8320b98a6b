//! Processes of a run: the runtime's service, an X server for its window, and the program itself.

use std::io::{BufRead, BufReader};
use std::net::TcpListener;
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

/// What scripts/test-vr has exported.
fn exported(name: &str) -> String {
    std::env::var(name).unwrap_or_else(|_| panic!("{name} is not set: scripts/test-vr sets it"))
}

/// What takes longer has hung. Nothing waits for time to go by.
pub const HANG: Duration = Duration::from_secs(600);

/// A command behind the words that the unpacked runtime's programs need in front, if any.
fn behind_prefix(program: &str) -> Command {
    let prefix = exported("INCISE_XR_PREFIX");
    let mut words = prefix.split_whitespace().chain([program]);
    let mut command = Command::new(words.next().expect("at least the program"));
    command.args(words);
    command
}

/// The command without the right to real-time threads, where that can be taken away. A service of root's composes in real time,
/// and with a software driver on few cores nobody else gets to do anything.
fn without_real_time(command: Command) -> Command {
    const WORDS: [&str; 2] = ["--bounding-set=-sys_nice", "--inh-caps=-sys_nice"];
    let mut bare = Command::new("setpriv");
    bare.args(WORDS).arg(command.get_program()).args(command.get_args());
    let works = Command::new("setpriv").args(WORDS).arg("true").stderr(Stdio::null()).status().is_ok_and(|s| s.success());
    if works { bare } else { command }
}

/// A child that does not outlive the test. Asked to end first, then made to.
pub struct Kept(Child);

impl Kept {
    pub fn spawn(command: &mut Command) -> Self {
        Self(command.stdin(Stdio::null()).spawn().expect("it starts"))
    }

    pub fn has_ended(&mut self) -> bool {
        matches!(self.0.try_wait(), Ok(Some(_)))
    }

    fn end(&mut self) {
        let id = self.0.id().to_string();
        let _ = Command::new("kill").arg(&id).stderr(Stdio::null()).status();
        if !within(Duration::from_secs(2), || self.has_ended()) {
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
    /// Into a window of an X server of its own; eyes of this percentage of their full size.
    Window(u32),
}

/// An X server that keeps its picture in a file.
pub struct Display {
    _server: Kept,
    name: String,
    folder: PathBuf,
}

impl Display {
    /// Starts one and waits until it says which number it has taken.
    fn start(folder: PathBuf, size: &str) -> Self {
        std::fs::create_dir_all(&folder).expect("a folder");
        let mut command = Command::new("Xvfb");
        command.args(["-displayfd", "1", "-screen", "0", size, "-nolisten", "tcp", "-fbdir"]).arg(&folder);
        let mut server = Kept::spawn(command.stdout(Stdio::piped()).stderr(Stdio::null()));
        let mut number = String::new();
        let said = BufReader::new(server.0.stdout.take().expect("piped")).read_line(&mut number);
        assert!(said.is_ok() && !number.trim().is_empty(), "Xvfb does not start");
        Self { _server: server, name: format!(":{}", number.trim()), folder }
    }

    /// What to set DISPLAY to.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The screen as it is now: RGB and its size.
    pub fn screen(&self) -> Screen {
        let bytes = std::fs::read(self.folder.join("Xvfb_screen0")).expect("the X server's picture");
        let word = |i: usize| u32::from_be_bytes(bytes[4 * i..4 * i + 4].try_into().expect("4 bytes"));
        // an X window dump: header size, then 4 width, 5 height, 12 bytes a line, 19 colours of 12 bytes each
        let (header, width, height, line, colours) = (word(0), word(4), word(5), word(12), word(19));
        let start = (header + 12 * colours) as usize;
        let row = |y: u32| &bytes[start + (y * line) as usize..][..4 * width as usize];
        let rgb = (0..height).flat_map(|y| row(y).chunks_exact(4).flat_map(|p| [p[2], p[1], p[0]])).collect();
        image::RgbImage::from_raw(width, height, rgb).expect("as large as it says")
    }

    /// The screen once it shows something and no longer changes.
    pub fn settled(&self) -> Screen {
        let mut last = self.screen();
        let still = within(HANG, || {
            std::thread::sleep(Duration::from_millis(300));
            let now = self.screen();
            let settled = lit_share(&now) > 0.05 && now == last;
            last = now;
            settled
        });
        assert!(still, "the screen shows nothing, or never the same: {} of it is lit", lit_share(&last));
        last
    }
}

/// A picture of an X server.
pub type Screen = image::RgbImage;

/// Share of pixels that are not nearly black.
pub fn lit_share(screen: &Screen) -> f64 {
    screen.pixels().filter(|p| p.0.iter().any(|&c| c > 40)).count() as f64 / screen.len().max(3) as f64 * 3.0
}

/// A runtime with a scripted headset, in a folder of its own.
pub struct Service {
    // In the order to end them: the service goes first, or it hangs for want of its X server.
    monado: Option<Kept>,
    /// Where the compositor shows its pictures, if it does.
    pub display: Option<Display>,
    /// Where windows of the program go, if they may.
    pub desktop: Option<Display>,
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
        Self { monado: None, display: None, desktop: None, folder, port: 0, compositor: Compositor::Null }
    }

    /// Starts a service and waits until it answers.
    pub fn start(name: &str, compositor: Compositor) -> Self {
        let mut service = Self::absent(name);
        service.compositor = compositor;
        if compositor != Compositor::Null {
            service.display = Some(Display::start(service.folder.join("display"), "960x540x24"));
        }
        service.start_monado();
        service
    }

    /// Gives the program a display for its windows.
    pub fn with_desktop(mut self) -> Self {
        self.desktop = Some(self.display("desktop"));
        self
    }

    /// Starts the service, anew after [`Service::kill`], and waits until it answers; a service that ends at once is tried again.
    pub fn start_monado(&mut self) {
        for _ in 0..5 {
            if self.try_monado() {
                return;
            }
            self.kill();
        }
        panic!("no service: {}", self.log());
    }

    fn try_monado(&mut self) -> bool {
        self.port = TcpListener::bind("127.0.0.1:0").and_then(|l| l.local_addr()).expect("a free port").port();
        let settings = format!(r#"{{"active":"remote","remote":{{"version":0,"port":{},"view_count":2}}}}"#, self.port);
        std::fs::write(self.folder.join("config/monado/config_v0.json"), settings).expect("written");
        let socket = self.folder.join("monado_comp_ipc");
        let _ = std::fs::remove_file(&socket);
        let mut command = without_real_time(behind_prefix(&exported("INCISE_XR_SERVICE")));
        self.environment(&mut command);
        command.env("XRT_NO_STDIN", "1").env_remove("VK_INSTANCE_LAYERS");
        match (self.compositor, &self.display) {
            (Compositor::Window(percent), Some(display)) => command
                .env("XRT_COMPOSITOR_FORCE_XCB", "1")
                .env("DISPLAY", display.name())
                .env("XRT_COMPOSITOR_SCALE_PERCENTAGE", percent.to_string())
                .env("XRT_COMPOSITOR_DEFAULT_FRAMERATE", "90"),
            _ => command.env("XRT_COMPOSITOR_NULL", "1"),
        };
        let log = std::fs::File::create(self.folder.join("service.log")).expect("a log");
        command.stdout(log.try_clone().expect("a log")).stderr(log);
        let monado = self.monado.insert(Kept::spawn(&mut command));
        let mut ended = false;
        within(HANG, || {
            ended = matches!(monado.0.try_wait(), Ok(Some(_)));
            ended || UnixStream::connect(&socket).is_ok()
        }) && !ended
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

    /// A display for a program's windows, in the service's folder.
    pub fn display(&self, name: &str) -> Display {
        Display::start(self.folder.join(name), "960x720x24")
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
        match &self.desktop {
            Some(desktop) => command.env("DISPLAY", desktop.name()),
            None => command.env_remove("DISPLAY"),
        };
        // The software driver compiles for many seconds, and keeps what it has compiled here.
        let compiled = Path::new(env!("CARGO_TARGET_TMPDIR")).join("shaders");
        command.env_remove("WAYLAND_DISPLAY").env("MESA_SHADER_CACHE_DIR", compiled);
        command
    }
}

impl Drop for Service {
    fn drop(&mut self) {
        self.monado = None;
        (self.display, self.desktop) = (None, None);
        if !std::thread::panicking() {
            let _ = std::fs::remove_dir_all(&self.folder);
        }
    }
}

/// Makes a shared library of a source in C beside this one, in the service's folder.
pub fn compile(service: &Service, source: &str, flags: &[&str]) -> PathBuf {
    let library = service.folder.join(source).with_extension("so");
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/vr").join(source);
    let compiler = std::env::var("CC").unwrap_or_else(|_| "cc".into());
    let made = Command::new(compiler).args(["-shared", "-fPIC", "-o"]).arg(&library).arg(source).args(flags).status();
    assert!(made.expect("a C compiler").success());
    library
}

/// Runs it to its end.
pub fn finish(command: &mut Command) -> Output {
    command.stdin(Stdio::null()).output().expect("it starts")
}

/// What it said on stderr.
pub fn complaint(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}
