//! Models that a user opens while a host runs, and what a panel does to the scene that is there: the same for a window and for
//! a headset.

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
/// Writes a scene to a file.
pub type Export = fn(&Scene, &Path) -> Result<(), String>;

/// A model that is being loaded behind the user's back, if any.
#[derive(Default)]
pub struct Loader {
    coming: Option<Receiver<Result<Loaded, String>>>,
}

impl Loader {
    /// Starts to load; `done` is called on the loader's thread when there is an answer. What there is to be told goes to the
    /// panel.
    pub fn begin(&mut self, load: &Load, request: Request, done: impl FnOnce() + Send + 'static, panel: &mut PanelState) {
        if self.coming.is_some() {
            panel.tell("A model is being loaded already; try again when it is there.");
            return;
        }
        let (sender, receiver) = channel();
        let (load, spec) = (load.clone(), request.model.clone());
        let begun = std::thread::Builder::new().name("loader".into()).spawn(move || {
            drop(sender.send(load(&request, &|_, _| {})));
            done();
        });
        match begun {
            Ok(_) => {
                panel.loading = Some(Progress { text: format!("loading {spec}"), part: 0.0 });
                self.coming = Some(receiver);
            }
            Err(why) => panel.fail(format!("cannot load {spec}: {why}; close other programs and try again")),
        }
    }

    /// A model that has come; one that could not be loaded is told of, and the current one stays. The flag says whether an answer
    /// came at all.
    pub fn take(&mut self, panel: &mut PanelState) -> (Option<Loaded>, bool) {
        let Some(receiver) = &self.coming else { return (None, false) };
        let result = match receiver.try_recv() {
            Err(TryRecvError::Empty) => return (None, false),
            Err(TryRecvError::Disconnected) => Err("the loader broke off; this model cannot be used".to_string()),
            Ok(result) => result,
        };
        self.coming = None;
        panel.loading = None;
        match result {
            Ok(loaded) => {
                panel.notice = None;
                if !loaded.warnings.is_empty() {
                    panel.tell(loaded.warnings.join("\n"));
                }
                (Some(loaded), true)
            }
            Err(why) => {
                panel.fail(format!("{why}\n\nThe model that was there stays."));
                (None, true)
            }
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

/// Writes the scene to export.glb in the current folder; the panel says how that went.
pub fn export(scene: &Scene, export: Export, panel: &mut PanelState) {
    let file = Path::new("export.glb");
    match export(scene, file) {
        Ok(()) => panel.tell(format!("Written: {}", file.display())),
        Err(why) => panel.fail(why),
    }
}

/// Writes the panel's settings to a file, whose words and comments stay; the panel says how that went.
pub fn save_config(file: &Path, panel: &mut PanelState) {
    if panel.spacing.is_some() {
        panel.config.particles.count = (panel.counts[2] as u32).max(1);
    }
    let written = read_if_there(file).and_then(|text| {
        let text = panel.config.rewrite(text.as_deref(), &file.display().to_string()).map_err(|e| e.to_string())?;
        std::fs::write(file, text).map_err(|e| format!("cannot write {}: {e}; start Incise where you may write", file.display()))
    });
    match written {
        Ok(()) => panel.tell(format!("Written: {}", file.display())),
        Err(why) => panel.fail(format!("{why}\n\nThe settings were not saved.")),
    }
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
    use std::time::{Duration, Instant};

    fn answer(loader: &mut Loader, panel: &mut PanelState) -> Option<Loaded> {
        let start = Instant::now();
        loop {
            match loader.take(panel) {
                (loaded, true) => return loaded,
                _ if start.elapsed() > Duration::from_secs(60) => panic!("no answer"),
                _ => std::thread::yield_now(),
            }
        }
    }

    #[test]
    fn a_model_that_cannot_be_loaded_leaves_what_was_there_and_says_so() {
        let (mut loader, mut panel) = (Loader::default(), PanelState::default());
        let request = Request { model: "nowhere.glb".into(), config: Config::default(), spacing: None };
        let fails: Load = Arc::new(|request, _| Err(format!("{}: no such file", request.model)));
        let (told, called) = channel();
        loader.begin(&fails, request.clone(), move || told.send(()).unwrap_or_default(), &mut panel);
        assert_eq!(panel.loading.as_ref().map(|p| p.text.as_str()), Some("loading nowhere.glb"));
        loader.begin(&fails, request, || (), &mut panel);
        assert!(panel.notice.take().is_some_and(|n| n.text.contains("already")), "one at a time");
        assert!(answer(&mut loader, &mut panel).is_none() && panel.loading.is_none());
        assert!(panel.notice.is_some_and(|n| n.error && n.text.contains("no such file") && n.text.contains("stays")));
        assert!(called.recv_timeout(Duration::from_secs(10)).is_ok(), "the host is woken");
        assert!(!loader.take(&mut PanelState::default()).1, "one answer a request");
    }

    #[test]
    fn settings_that_cannot_be_written_say_so() {
        let mut panel = PanelState::default();
        save_config(Path::new("/no/such/folder/config.toml"), &mut panel);
        assert!(panel.notice.take().is_some_and(|n| n.error && n.text.contains("/no/such/folder")));
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("config.toml");
        panel.config.vr.tip_offset = [0.01, -0.02, -0.2];
        save_config(&file, &mut panel);
        assert_eq!(Config::load(&file).expect("it can be read").vr.tip_offset, [0.01, -0.02, -0.2]);
    }
}
