//! Pictures of the window that go into files: one by one, or of every frame.

use super::screen::Shot;
use std::path::{Path, PathBuf};

/// Where pictures go, and how many there are.
#[derive(Default)]
pub struct Pictures {
    /// The last number given, in `screenshots` and in `recording`.
    last: [u32; 2],
    recorded: u32,
}

impl Pictures {
    /// Writes a picture under the next free number. The error says what to do.
    pub fn write(&mut self, (width, height, pixels): &Shot, recording: bool) -> Result<PathBuf, String> {
        let folder = Path::new(if recording { "recording" } else { "screenshots" });
        let last = &mut self.last[usize::from(recording)];
        let written = std::fs::create_dir_all(folder).map_err(|e| e.to_string()).and_then(|()| {
            let file = (*last + 1..).map(|n| (n, folder.join(format!("incise-{n:05}.png")))).find(|f| !f.1.exists());
            let Some((number, file)) = file else { return Err("there is no number left".to_string()) };
            *last = number;
            image::save_buffer(&file, pixels, *width, *height, image::ColorType::Rgba8).map_err(|e| e.to_string())?;
            Ok(file)
        });
        self.recorded += u32::from(recording && written.is_ok());
        written.map_err(|why| format!("cannot write a picture in {}: {why}; start Incise where you may write", folder.display()))
    }

    /// What a recording that has ended is to be told of, once; nothing if none has.
    pub fn end_recording(&mut self) -> Option<String> {
        let count = std::mem::take(&mut self.recorded);
        (count > 0).then(|| format!("Written: {count} picture(s) in recording"))
    }
}
