//! Models that a user opens while a host runs, and what a panel does to the scene that is there: the same for a window and for
//! a headset.

use super::writer::{Encode, Order, Wake};
use crate::app::App;
use crate::config::Config;
use crate::panel::{PanelState, Progress};
use crate::physics::NetworkSettings;
use crate::scene::{Scene, TissueId};
use std::path::Path;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, TryRecvError, channel};

/// A model that the user wants to see.
#[derive(Clone, Debug)]
pub struct Request {
    /// A file or a bundled name.
    pub model: String,
    /// The settings as they are now.
    pub config: Config,
    /// Spacing of the particles, metres, where the user has set one.
    pub spacing: Option<f64>,
}

/// A model that is ready.
pub struct Loaded {
    /// With particles, at rest.
    pub scene: Scene,
    /// What to call it: the request's words.
    pub name: String,
    /// What the user should know of it.
    pub warnings: Vec<String>,
}

/// Told what is being done, and how much of the whole is behind it, from 0 to 1.
pub type Tell<'a> = &'a dyn Fn(&'static str, f32);
/// Loads a model; the error names the remedy. Called on another thread.
pub type Load = Arc<dyn Fn(&Request, Tell) -> Result<Loaded, String> + Send + Sync>;
/// Takes of a scene what a file needs; the frame goes on meanwhile.
pub type Export = fn(&Scene) -> Encode;

/// What the loader's thread says.
enum Word {
    /// It is at this, with this part behind it.
    Step(&'static str, f32),
    /// It is done.
    Done(Box<Result<Loaded, String>>),
}

/// What has come of a request.
pub enum Arrival {
    /// Nothing yet.
    Nothing,
    /// The panel has something new to show, but there is no other model.
    Told,
    /// A model, and what was asked for.
    Model(Box<(Request, Loaded)>),
}

/// Loads models behind the user's back, one at a time; of several wishes the last one counts.
#[derive(Default)]
pub struct Loader {
    wake: Wake,
    coming: Option<(Request, Receiver<Word>)>,
    next: Option<(Load, Request)>,
}

impl Loader {
    /// One that tells when there is something to take.
    pub fn new(wake: Wake) -> Self {
        Self { wake, ..Self::default() }
    }

    /// Starts to load, or will when the model that is being loaded is there. What there is to be told goes to the panel.
    pub fn begin(&mut self, load: &Load, request: Request, panel: &mut PanelState) {
        if let Some((coming, _)) = &self.coming {
            if coming.model != request.model {
                panel.tell(format!("{} is being loaded already; {} comes after it.", coming.model, request.model));
            }
            self.next = Some((load.clone(), request));
            return;
        }
        let (sender, receiver) = channel();
        let (load, wake, wanted) = (load.clone(), self.wake.clone(), request.clone());
        let begun = std::thread::Builder::new().name("loader".into()).spawn(move || {
            let say = |word| {
                drop(sender.send(word));
                wake.call();
            };
            let done = load(&request, &|what, part| say(Word::Step(what, part)));
            say(Word::Done(Box::new(done)));
        });
        match begun {
            Ok(_) => {
                panel.loading = Some(Progress { text: format!("loading {}", wanted.model), part: 0.0 });
                self.coming = Some((wanted, receiver));
            }
            Err(why) => panel.fail(format!("cannot load {}: {why}; close other programs and try again", wanted.model)),
        }
    }

    /// Takes what has come. A model that could not be loaded is told of, and the current one stays; one that another wish has
    /// overtaken is dropped.
    pub fn take(&mut self, panel: &mut PanelState) -> Arrival {
        let mut told = false;
        let result = loop {
            let Some((wanted, receiver)) = &self.coming else { return Arrival::Nothing };
            match receiver.try_recv() {
                Err(TryRecvError::Empty) => return if told { Arrival::Told } else { Arrival::Nothing },
                Err(TryRecvError::Disconnected) => break Err("the loader broke off; this model cannot be used".to_string()),
                Ok(Word::Step(what, part)) => {
                    panel.loading = Some(Progress { text: format!("{}: {what}", wanted.model), part });
                    told = true;
                }
                Ok(Word::Done(result)) => break *result,
            }
        };
        panel.loading = None;
        let wanted = self.coming.take().map(|(wanted, _)| wanted);
        if let Some((load, request)) = self.next.take() {
            self.begin(&load, request, panel);
            return Arrival::Told;
        }
        match (result, wanted) {
            (Ok(loaded), Some(wanted)) => {
                panel.notice = None;
                if !loaded.warnings.is_empty() {
                    panel.tell(loaded.warnings.join("\n"));
                }
                Arrival::Model(Box::new((wanted, loaded)))
            }
            (Err(why), _) => {
                panel.fail(format!("{why}\n\nThe model that was there stays."));
                Arrival::Told
            }
            (Ok(_), None) => Arrival::Nothing,
        }
    }
}

/// Live vertices, faces, particles, pieces: what a panel says of a model.
pub fn counts(scene: &Scene) -> [usize; 4] {
    let mut counts = [0; 4];
    for (_, tissue) in scene.tissues() {
        counts[0] += tissue.mesh().live_vertices().count();
        counts[1] += tissue.mesh().face_count();
        counts[2] += tissue.layer().map_or(0, |l| l.map.anchors.iter().filter(|a| a.is_some()).count());
        counts[3] += 1;
    }
    counts
}

/// Springs, wounds and walls as the panel's settings have them, on what is there.
pub fn apply_settings(app: &mut App, panel: &mut PanelState) {
    let config = &panel.config;
    let network = NetworkSettings::from(config.dynamics.active());
    app.scene.set_wall(config.tear.wall);
    let ids: Vec<TissueId> = app.scene.tissues().map(|(id, _)| id).collect();
    let mut refused = None;
    for id in ids {
        let Some(layer) = app.scene.tissue_mut(id).and_then(|t| t.layer_mut()) else { continue };
        layer.settings.wound.gap = config.tear.gap * panel.diagonal;
        layer.opening_s = config.tear.opening_time;
        refused = layer.network.set_settings(network).err().or(refused);
    }
    if let Some(why) = refused {
        panel.fail(format!("{why}; the springs stay as they were"));
    }
}

/// The scene as it is now, to be written to export.glb in the current folder.
pub fn export(scene: &Scene, export: Export) -> Order {
    Order::Model("export.glb".into(), export(scene))
}

/// The panel's settings as they are now, to be written to a file, whose words and comments stay.
pub fn save_config(file: &Path, panel: &mut PanelState) -> Order {
    if panel.spacing.is_some() {
        panel.config.particles.count = (panel.counts[2] as u32).max(1);
    }
    Order::Settings(file.to_path_buf(), Box::new(panel.config.clone()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::{Duration, Instant};

    /// Waits for the end of what is being loaded; the model that came, and the progress that was told meanwhile.
    fn answer(loader: &mut Loader, panel: &mut PanelState) -> (Option<Loaded>, Vec<String>) {
        let (start, mut told) = (Instant::now(), Vec::new());
        while start.elapsed() < Duration::from_secs(60) {
            match loader.take(panel) {
                Arrival::Model(came) => return (Some(came.1), told),
                Arrival::Told => match &panel.loading {
                    Some(progress) => told.push(format!("{} {}", progress.text, progress.part)),
                    None => return (None, told),
                },
                Arrival::Nothing => std::thread::yield_now(),
            }
        }
        panic!("no answer")
    }

    #[test]
    fn a_model_that_cannot_be_loaded_leaves_what_was_there_and_says_so() {
        let (told, called) = channel();
        let mut loader = Loader::new(Wake::new(move || told.send(()).unwrap_or_default()));
        let mut panel = PanelState::default();
        let request = |model: &str| Request { model: model.into(), config: Config::default(), spacing: None };
        let (open_gate, gate) = channel::<()>();
        let gate = std::sync::Mutex::new(gate);
        let fails: Load = Arc::new(move |request, tell| {
            tell("reading", 0.25);
            gate.lock().expect("one thread").recv().expect("let on");
            Err(format!("{}: no such file", request.model))
        });
        loader.begin(&fails, request("nowhere.glb"), &mut panel);
        assert_eq!(panel.loading.as_ref().map(|p| p.text.as_str()), Some("loading nowhere.glb"));
        assert!(called.recv_timeout(Duration::from_secs(60)).is_ok(), "the host is woken for a step");
        assert!(matches!(loader.take(&mut panel), Arrival::Told));
        assert_eq!(panel.loading, Some(Progress { text: "nowhere.glb: reading".into(), part: 0.25 }));
        assert!(matches!(loader.take(&mut panel), Arrival::Nothing), "each word once");
        for model in ["there.glb", "elsewhere.glb"] {
            loader.begin(&fails, request(model), &mut panel);
            assert!(panel.notice.take().is_some_and(|n| n.text.contains("already") && n.text.contains(model)), "one at a time");
        }
        loader.begin(&fails, request("nowhere.glb"), &mut panel);
        assert!(panel.notice.is_none(), "the same model with other settings is no news");
        loader.begin(&fails, request("elsewhere.glb"), &mut panel);
        panel.notice = None;
        (0..2).for_each(|_| open_gate.send(()).expect("the loader waits"));
        let (loaded, told) = answer(&mut loader, &mut panel);
        assert!(loaded.is_none() && panel.loading.is_none());
        assert!(told.iter().all(|t| !t.contains("there.glb: ") || t.contains("elsewhere")), "overtaken: {told:?}");
        let notice = panel.notice.take().expect("an error");
        assert!(
            notice.error && notice.text.contains("elsewhere.glb: no such file") && notice.text.contains("stays"),
            "{notice:?}"
        );
        assert!(called.recv_timeout(Duration::from_secs(60)).is_ok(), "the host is woken for an answer");
        assert!(matches!(loader.take(&mut panel), Arrival::Nothing), "one answer a request");
    }

    #[test]
    fn a_loader_that_panics_is_an_error() {
        let (mut loader, mut panel) = (Loader::default(), PanelState::default());
        let request = Request { model: "odd.glb".into(), config: Config::default(), spacing: None };
        let breaks: Load = Arc::new(|_, _| panic!("on purpose"));
        loader.begin(&breaks, request, &mut panel);
        assert!(answer(&mut loader, &mut panel).0.is_none() && panel.loading.is_none());
        assert!(panel.notice.is_some_and(|n| n.error && n.text.contains("broke off")));
    }
}
