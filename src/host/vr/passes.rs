//! Whether both eyes are drawn in one pass: what the settings ask for and the adapter can.

use crate::config::Multiview;
use crate::gpu::{Context, Passes};

/// How a session draws its eyes, with so many samples a pixel. Where one pass is asked for and the adapter has none, that is said, and
/// each eye gets a pass of its own.
pub fn choose(asked: Multiview, context: &Context, samples: u32) -> Passes {
    let wanted = match asked {
        Multiview::Auto => Passes::Auto,
        Multiview::On => Passes::AtOnce,
        Multiview::Off => Passes::Each,
    };
    if wanted.at_once(context, 2, samples) {
        return Passes::AtOnce;
    }
    if asked == Multiview::On {
        tracing::warn!("vr.multiview is \"on\", but {} cannot draw both eyes at once: a pass for each", context.adapter_name());
    }
    Passes::Each
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gpu::ContextOptions;
    use std::io::Write;
    use std::sync::{Arc, Mutex};

    /// A log in memory.
    #[derive(Clone, Default)]
    struct Log(Arc<Mutex<Vec<u8>>>);

    impl Write for Log {
        fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
            self.0.lock().expect("one thread").write(bytes)
        }

        fn flush(&mut self) -> std::io::Result<()> {
            Ok(())
        }
    }

    /// What is chosen, and what is said of it.
    fn chosen(asked: Multiview, context: &Context, samples: u32) -> (Passes, String) {
        let log = Log::default();
        let kept = log.clone();
        let subscriber = tracing_subscriber::fmt().with_writer(move || kept.clone()).without_time().finish();
        let passes = tracing::subscriber::with_default(subscriber, || choose(asked, context, samples));
        let said = log.0.lock().expect("one thread").clone();
        (passes, String::from_utf8(said).expect("text"))
    }

    #[test]
    fn an_adapter_without_multiview_is_told_of_where_it_is_asked_for_and_draws_in_turn() {
        let open = |plain: bool| Context::headless(ContextOptions { plain, ..Default::default() }).expect("an adapter");
        let (without, with) = (open(true), open(false));
        for samples in [1, 4] {
            let (passes, said) = chosen(Multiview::On, &without, samples);
            assert_eq!(passes, Passes::Each);
            assert!(said.contains("WARN") && said.contains("vr.multiview") && said.contains(without.adapter_name()), "{said}");
            for asked in [Multiview::Auto, Multiview::Off] {
                assert_eq!(chosen(asked, &without, samples), (Passes::Each, String::new()), "{asked:?}: nobody has asked for it");
            }
        }
        assert_eq!(chosen(Multiview::Off, &with, 1), (Passes::Each, String::new()));
        if with.draws_views_at_once(2, 1) {
            assert_eq!(chosen(Multiview::On, &with, 1), (Passes::AtOnce, String::new()), "no word where it can");
            let auto = if with.prefers_views_at_once() { Passes::AtOnce } else { Passes::Each };
            assert_eq!(chosen(Multiview::Auto, &with, 1), (auto, String::new()));
        }
    }
}
