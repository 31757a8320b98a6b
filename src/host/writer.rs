//! Files, written on a thread of their own: a frame takes what is to be written as it is then, and goes on. What came of it is told
//! later. Whoever ends waits until everything is written.

use crate::config::Config;
use crate::panel::PanelState;
use std::collections::VecDeque;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread::JoinHandle;

/// Turns what a frame has taken into bytes: of a file, or pixels. Called on the writer's thread, which may wait.
pub type Encode = Box<dyn FnOnce() -> Result<Vec<u8>, String> + Send>;

/// Tells a host from another thread that there is something to take. By default there is nobody to be told: whoever makes frames
/// all the time looks by itself.
#[derive(Clone)]
pub struct Wake(Arc<dyn Fn() + Send + Sync>);

impl Wake {
    /// Calls this on the other thread.
    pub fn new(call: impl Fn() + Send + Sync + 'static) -> Self {
        Self(Arc::new(call))
    }

    /// Tells.
    pub fn call(&self) {
        (self.0)();
    }
}

impl Default for Wake {
    fn default() -> Self {
        Self::new(|| ())
    }
}

/// Where a picture goes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Album {
    /// One by one, of a window.
    Screenshots,
    /// Of every frame of a window.
    Recording,
    /// One by one, of what the left eye sees.
    Headset,
}

impl Album {
    fn folder(self) -> &'static Path {
        Path::new(if self == Self::Recording { "recording" } else { "screenshots" })
    }

    fn file(self, number: u32) -> PathBuf {
        self.folder().join(match self {
            Self::Headset => format!("incise-vr-{number:04}.png"),
            _ => format!("incise-{number:05}.png"),
        })
    }
}

/// What is to be written.
pub enum Order {
    /// A picture under the next free number.
    Picture {
        /// Where.
        album: Album,
        /// Pixels.
        width: u32,
        /// Pixels.
        height: u32,
        /// RGBA8, rows from the top, once the GPU has them.
        pixels: Encode,
    },
    /// No more pictures of every frame: how many there are is told.
    EndRecording,
    /// A model.
    Model(PathBuf, Encode),
    /// Settings, into a file whose words and comments stay.
    Settings(PathBuf, Box<Config>),
}

/// What came of an order.
enum Answer {
    /// Done, and nothing to be told.
    Silent,
    Told(String),
    Failed(String),
    /// A picture of every frame could not be written: there will be no more.
    RecordingFailed(String),
}

/// Pictures that are under way at most while every frame is written: then a frame waits.
const MOST_UNDER_WAY: usize = 8;

/// Writes files behind a frame's back, in the order that they were asked for.
#[derive(Default)]
pub struct Writer {
    wake: Wake,
    thread: Option<Thread>,
    under_way: usize,
    /// Answers that a waiting frame has taken and nobody has been told of.
    taken: VecDeque<Answer>,
}

struct Thread {
    orders: Sender<Order>,
    answers: Receiver<Answer>,
    handle: JoinHandle<()>,
}

impl Writer {
    /// One that tells when there is something to take.
    pub fn new(wake: Wake) -> Self {
        Self { wake, thread: None, under_way: 0, taken: VecDeque::new() }
    }

    /// Has it written. Does not wait, but for a recording that the disk does not keep up with.
    pub fn order(&mut self, order: Order) {
        let recorded = matches!(order, Order::Picture { album: Album::Recording, .. });
        if recorded {
            self.wait_for(MOST_UNDER_WAY - 1);
        }
        if self.thread.is_none() {
            match Thread::start(self.wake.clone()) {
                Ok(thread) => self.thread = Some(thread),
                Err(why) => {
                    let words = format!("nothing can be written: {why}; close other programs and try again");
                    return self.taken.push_back(Answer::Failed(words));
                }
            }
        }
        if let Some(thread) = &self.thread {
            self.under_way += 1;
            drop(thread.orders.send(order)); // it listens as long as we do
        }
    }

    /// Waits until all is written, as before what it is taken from is gone.
    pub fn finish(&mut self) {
        self.wait_for(0);
    }

    /// Waits until so many orders at most are under way.
    fn wait_for(&mut self, most: usize) {
        while self.under_way > most {
            let Some(answer) = self.thread.as_ref().and_then(|t| t.answers.recv().ok()) else { break };
            self.under_way -= 1;
            self.taken.push_back(answer);
        }
    }

    /// Tells the panel what has been written meanwhile, or why not. True if there was anything to tell.
    pub fn take(&mut self, panel: &mut PanelState) -> bool {
        if self.under_way == 0 && self.taken.is_empty() {
            return false;
        }
        if let Some(thread) = &self.thread {
            for answer in thread.answers.try_iter() {
                self.under_way -= 1;
                self.taken.push_back(answer);
            }
        }
        let mut told = false;
        for answer in self.taken.drain(..) {
            told |= !matches!(answer, Answer::Silent);
            match answer {
                Answer::Silent => {}
                Answer::Told(words) => panel.tell(words),
                Answer::Failed(why) => panel.fail(why),
                Answer::RecordingFailed(why) => {
                    panel.recording = false;
                    panel.fail(why);
                }
            }
        }
        told
    }
}

impl Drop for Writer {
    /// Waits until all is written; what nobody was told of goes to the log.
    fn drop(&mut self) {
        let left = self.thread.take().map(|Thread { orders, answers, handle }| {
            drop(orders);
            drop(handle.join());
            answers
        });
        for answer in self.taken.drain(..).chain(left.iter().flatten()) {
            match answer {
                Answer::Silent => {}
                Answer::Told(words) => tracing::info!("{words}"),
                Answer::Failed(why) | Answer::RecordingFailed(why) => tracing::warn!("{why}"),
            }
        }
    }
}

impl Thread {
    fn start(wake: Wake) -> std::io::Result<Self> {
        let (orders, asked) = channel::<Order>();
        let (sender, answers) = channel();
        let handle = std::thread::Builder::new().name("writer".into()).spawn(move || {
            let mut pictures = Pictures::default();
            for order in asked {
                let answer = catch_unwind(AssertUnwindSafe(|| pictures.carry_out(order)))
                    .unwrap_or_else(|_| Answer::Failed("the writer broke off; this file is not what it should be".into()));
                let silent = matches!(answer, Answer::Silent);
                drop(sender.send(answer)); // who does not listen has left
                if !silent {
                    wake.call();
                }
            }
        })?;
        Ok(Self { orders, answers, handle })
    }
}

/// How many pictures there are.
#[derive(Default)]
struct Pictures {
    /// The last number given, by [`Album`].
    last: [u32; 3],
    recorded: u32,
}

impl Pictures {
    fn carry_out(&mut self, order: Order) -> Answer {
        let told = |file: &Path| Answer::Told(format!("Written: {}", file.display()));
        match order {
            Order::Picture { album, width, height, pixels } => match self.write(album, (width, height), pixels) {
                Ok(_) if album == Album::Recording => {
                    self.recorded += 1;
                    Answer::Silent
                }
                Ok(file) => told(&file),
                Err(why) if album == Album::Recording => Answer::RecordingFailed(why),
                Err(why) => Answer::Failed(why),
            },
            Order::EndRecording => match std::mem::take(&mut self.recorded) {
                0 => Answer::Silent,
                count => Answer::Told(format!("Written: {count} picture(s) in recording")),
            },
            Order::Model(file, encode) => match encode().and_then(|bytes| write(&file, bytes)) {
                Ok(()) => told(&file),
                Err(why) => Answer::Failed(format!("{why}; start Incise where you may write")),
            },
            Order::Settings(file, config) => match save(&file, &config) {
                Ok(()) => told(&file),
                Err(why) => Answer::Failed(format!("{why}\n\nThe settings were not saved.")),
            },
        }
    }

    /// Writes a picture under the next free number. The error says what to do.
    fn write(&mut self, album: Album, (width, height): (u32, u32), pixels: Encode) -> Result<PathBuf, String> {
        let pixels = pixels().map_err(|why| format!("a picture was lost: {why}; try again"))?;
        let folder = album.folder();
        let last = &mut self.last[album as usize];
        let written = std::fs::create_dir_all(folder).map_err(|e| e.to_string()).and_then(|()| {
            let file = (*last + 1..).map(|n| (n, album.file(n))).find(|f| !f.1.exists());
            let Some((number, file)) = file else { return Err("there is no number left".to_string()) };
            *last = number;
            image::save_buffer(&file, &pixels, width, height, image::ColorType::Rgba8).map_err(|e| e.to_string())?;
            Ok(file)
        });
        written.map_err(|why| format!("cannot write a picture in {}: {why}; start Incise where you may write", folder.display()))
    }
}

fn write(file: &Path, bytes: Vec<u8>) -> Result<(), String> {
    std::fs::write(file, bytes).map_err(|e| format!("cannot write {}: {e}", file.display()))
}

/// Writes settings into a file, whose words and comments stay.
fn save(file: &Path, config: &Config) -> Result<(), String> {
    let text = read_if_there(file)?;
    let text = config.rewrite(text.as_deref(), &file.display().to_string()).map_err(|e| e.to_string())?;
    write(file, text.into_bytes()).map_err(|why| format!("{why}; start Incise where you may write"))
}

/// The text of a file; `None` if there is no such file.
fn read_if_there(file: &Path) -> Result<Option<String>, String> {
    match std::fs::read_to_string(file) {
        Ok(text) => Ok(Some(text)),
        Err(why) if why.kind() == std::io::ErrorKind::NotFound => Ok(None),
        Err(why) => Err(format!("cannot read {}: {why}", file.display())),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::mpsc::sync_channel;
    use std::time::Duration;

    /// A writer, and what tells that it has something to say.
    fn writer() -> (Writer, Receiver<()>) {
        let (waker, woken) = channel();
        (Writer::new(Wake::new(move || waker.send(()).unwrap_or_default())), woken)
    }

    /// What an order comes to.
    fn answer((writer, woken): &mut (Writer, Receiver<()>), order: Order) -> PanelState {
        writer.order(order);
        woken.recv_timeout(Duration::from_secs(60)).expect("the host is woken");
        let mut panel = PanelState { recording: true, ..PanelState::default() };
        assert!(writer.take(&mut panel) && !writer.take(&mut panel), "each word once");
        panel
    }

    #[test]
    fn settings_are_written_or_it_is_said_why_not() {
        let mut writer = writer();
        let settings = |file: &Path| {
            let mut config = Config::default();
            config.vr.tip_offset = [0.01, -0.02, -0.2];
            Order::Settings(file.to_path_buf(), Box::new(config))
        };
        let said = answer(&mut writer, settings(Path::new("/no/such/folder/config.toml"))).notice.expect("told");
        assert!(said.error && said.text.contains("/no/such/folder") && said.text.contains("not saved"));
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("config.toml");
        let said = answer(&mut writer, settings(&file)).notice.expect("told");
        assert!(!said.error && said.text.contains("config.toml"), "{said:?}");
        assert_eq!(Config::load(&file).expect("it can be read").vr.tip_offset, [0.01, -0.02, -0.2]);
    }

    #[test]
    fn a_model_that_breaks_is_said_and_the_next_is_written() {
        let mut writer = writer();
        let folder = tempfile::tempdir().expect("a folder");
        let model = |encode: Encode| Order::Model(folder.path().join("export.glb"), encode);
        for (encode, words) in [
            (Box::new(|| Err("the scene is empty".to_string())) as Encode, "the scene is empty"),
            (Box::new(|| panic!("on purpose")), "broke off"),
        ] {
            let said = answer(&mut writer, model(encode)).notice.expect("told");
            assert!(said.error && said.text.contains(words), "{said:?}");
        }
        let said = answer(&mut writer, model(Box::new(|| Ok(vec![1, 2, 3])))).notice.expect("told");
        assert!(!said.error && std::fs::read(folder.path().join("export.glb")).is_ok_and(|bytes| bytes == [1, 2, 3]));
    }

    #[test]
    fn nobody_waits_for_a_slow_disk_but_whoever_ends() {
        let mut writer = Writer::default();
        let folder = tempfile::tempdir().expect("a folder");
        let (open_gate, gate) = sync_channel::<()>(1);
        let files = [1, 2].map(|n| folder.path().join(format!("{n}.glb")));
        let encode: Encode = Box::new(move || {
            gate.recv().expect("let on");
            Ok(vec![7])
        });
        writer.order(Order::Model(files[0].clone(), encode));
        writer.order(Order::Model(files[1].clone(), Box::new(|| Ok(vec![8]))));
        let mut panel = PanelState::default();
        assert!(!writer.take(&mut panel) && panel.notice.is_none() && !files[0].exists(), "both are under way");
        open_gate.send(()).expect("it waits");
        drop(writer);
        assert!(files.iter().all(|file| file.exists()), "nothing is lost at the end");
    }

    #[test]
    fn a_picture_that_the_gpu_loses_is_said_and_one_that_is_late_holds_nobody_up() {
        let mut writer = writer();
        let (open_gate, gate) = sync_channel::<()>(1);
        let late: Encode = Box::new(move || {
            gate.recv().expect("let on");
            Err("the device is gone".into())
        });
        let picture = |pixels| Order::Picture { album: Album::Screenshots, width: 1, height: 1, pixels };
        writer.0.order(picture(late));
        assert!(!writer.0.take(&mut PanelState::default()), "under way");
        open_gate.send(()).expect("it waits");
        writer.0.finish();
        let mut panel = PanelState::default();
        assert!(writer.0.take(&mut panel), "finished: there is a word");
        assert!(panel.notice.is_some_and(|n| n.error && n.text.contains("the device is gone")));
    }

    #[test]
    fn pictures_of_every_frame_are_counted_and_end_where_one_fails() {
        let mut pictures = Pictures::default();
        assert!(matches!(pictures.carry_out(Order::EndRecording), Answer::Silent), "nothing was recorded");
        pictures.recorded = 3;
        assert!(matches!(pictures.carry_out(Order::EndRecording), Answer::Told(words) if words.contains("3 picture(s)")));
        let mut writer = Writer::default();
        writer.taken.push_back(Answer::RecordingFailed("full".into()));
        let mut panel = PanelState { recording: true, ..PanelState::default() };
        assert!(writer.take(&mut panel) && !panel.recording && panel.notice.is_some_and(|n| n.error));
    }
}
