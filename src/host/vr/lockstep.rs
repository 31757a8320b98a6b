//! Lockstep with a test driver. The driver moves the controllers of a runtime without a headset (Monado's `remote` driver) and
//! says over a second connection what it has sent; the program waits until it sees just that through OpenXR, and so does the
//! same in every run. Lines of text:
//!
//! | from | line | meaning |
//! |---|---|---|
//! | program | `ready {json}` | the session has focus; where the model stands |
//! | program | `frame N` | frame N waits for its input |
//! | program | `frame N unfocused` | the same while the runtime's own menu has the hands: what the driver expects is not waited for |
//! | driver | `expect` and 10 numbers, maybe `gpu` and one more, maybe `capture` | left hand x y z trigger squeeze, right hand the same, `bare` instead of a hand's five where it holds no controller; milliseconds that the GPU is to have taken; keep this frame's pictures |
//! | driver | `pass` | nothing moves in this frame: it is for what the runtime has to say |
//! | driver | `quit` | leave |

use super::error::VrError;
use super::input::Hand;
use glam::DVec3;
use std::io::{BufRead, BufReader, Write};
use std::net::{SocketAddr, TcpStream};
use std::time::{Duration, Instant};

/// How long the runtime may take to pass input on, and the driver to answer, before the run counts as hung.
const PATIENCE: Duration = Duration::from_secs(600);

/// What the driver has sent to the runtime.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Expected {
    /// These hands.
    Hands([Wanted; 2], Asked),
    /// None: the frame is shown as it is.
    Pass,
    /// The run is over.
    Quit,
}

/// What the driver wants of a frame besides.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Asked {
    /// Keep the frame's pictures.
    pub capture: bool,
    /// What the GPU is to have taken for a frame, milliseconds; 0 if nothing is said.
    pub gpu_ms: f64,
}

/// One hand, as sent: bit for bit.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Wanted {
    position: [f32; 3],
    trigger: f32,
    squeeze: f32,
    /// Fingers are made up by the runtime, so nothing else is known of them.
    bare: bool,
}

impl Wanted {
    fn matches(&self, hand: &Hand) -> bool {
        if self.bare || hand.bare {
            return self.bare == hand.bare;
        }
        let at = hand.grip.map(|g| g.position);
        let same = |p: DVec3| p.as_vec3().to_array() == self.position;
        at.is_some_and(same) && hand.tear as f32 == self.trigger && hand.grab as f32 == self.squeeze
    }
}

/// The connection to the driver.
pub struct Lockstep {
    lines: BufReader<TcpStream>,
    frames: u64,
}

impl Lockstep {
    /// Connects to a driver that listens at `address`.
    pub fn connect(address: SocketAddr) -> Result<Self, VrError> {
        let stream = TcpStream::connect(address).map_err(broken)?;
        stream.set_nodelay(true).map_err(broken)?;
        stream.set_read_timeout(Some(PATIENCE)).map_err(broken)?;
        Ok(Self { lines: BufReader::new(stream), frames: 0 })
    }

    /// Tells the driver that input arrives from now on.
    pub fn ready(&mut self, what: &str) -> Result<(), VrError> {
        self.say(&format!("ready {what}"))
    }

    /// Asks for a frame's input, which is ours to see or, while the runtime's menu is open, not.
    pub fn input(&mut self, focused: bool) -> Result<Expected, VrError> {
        self.say(&format!("frame {}{}", self.frames, if focused { "" } else { " unfocused" }))?;
        self.frames += 1;
        let mut line = String::new();
        self.lines.read_line(&mut line).map_err(broken)?;
        parse(&line).ok_or_else(|| VrError::Lockstep(format!("the driver says {line:?}")))
    }

    fn say(&mut self, line: &str) -> Result<(), VrError> {
        self.lines.get_mut().write_all(format!("{line}\n").as_bytes()).map_err(broken)
    }
}

/// Reads hands through `look` until they are as the driver sent them, twice: a runtime may take buttons over before poses, and
/// those of the second look are at least as new as the poses of the first.
pub fn wait_until_seen(wanted: &[Wanted; 2], mut look: impl FnMut() -> Result<[Hand; 2], VrError>) -> Result<(), VrError> {
    let start = Instant::now();
    let mut matched = false;
    loop {
        let seen = look()?;
        let matches = wanted.iter().zip(&seen).all(|(wanted, hand)| wanted.matches(hand));
        if matches && std::mem::replace(&mut matched, matches) {
            return Ok(());
        }
        matched = matches;
        if start.elapsed() > PATIENCE {
            return Err(VrError::Lockstep(format!("sent {wanted:?}, but the runtime shows {seen:?}")));
        }
    }
}

fn broken(error: std::io::Error) -> VrError {
    VrError::Lockstep(error.to_string())
}

fn parse(line: &str) -> Option<Expected> {
    let mut words = line.split_whitespace();
    match words.next()? {
        "quit" => Some(Expected::Quit),
        "pass" => Some(Expected::Pass),
        "expect" => {
            let number = |word: &str| word.parse::<f32>().ok().filter(|n| n.is_finite());
            let mut hand = || match words.next()? {
                "bare" => Some(Wanted { bare: true, ..Wanted::default() }),
                x => {
                    let mut number = |word: Option<&str>| number(word.or_else(|| words.next())?);
                    let position = [number(Some(x))?, number(None)?, number(None)?];
                    Some(Wanted { position, trigger: number(None)?, squeeze: number(None)?, bare: false })
                }
            };
            let hands = [hand()?, hand()?];
            let mut asked = Asked::default();
            let mut word = words.next();
            if word == Some("gpu") {
                asked.gpu_ms = words.next()?.parse().ok().filter(|ms: &f64| ms.is_finite() && *ms >= 0.0)?;
                word = words.next();
            }
            if word == Some("capture") {
                asked.capture = true;
                word = words.next();
            }
            word.is_none().then_some(Expected::Hands(hands, asked))
        }
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::super::space::Pose;
    use super::*;

    #[test]
    fn lines_of_the_driver_are_read() {
        assert_eq!(parse("quit\n"), Some(Expected::Quit));
        assert_eq!(parse("pass\n"), Some(Expected::Pass));
        let Some(Expected::Hands(hands, asked)) = parse("expect 1 2 3 0.5 0 4 5 6 1 0.25 gpu 20.5 capture\n") else {
            panic!("not read")
        };
        assert_eq!(asked, Asked { capture: true, gpu_ms: 20.5 });
        assert!(hands[0].trigger == 0.5 && hands[1].position == [4.0, 5.0, 6.0] && hands[1].squeeze == 0.25);
        let Some(Expected::Hands(hands, _)) = parse("expect bare 4 5 6 1 0.25\n") else { panic!("not read") };
        assert!(hands[0].bare && !hands[1].bare && hands[1].trigger == 1.0);
        for bad in
            ["", "\n", "expect 1 2 3", "expect 1 2 3 0 0 1 2 x 0 0", "expect 1 2 3 0 0 1 2 3 0 0 more", "expect bare", "leave"]
        {
            assert_eq!(parse(bad), None, "{bad:?}");
        }
    }

    #[test]
    fn a_hand_matches_bit_for_bit() {
        let position = DVec3::new(0.1f32.into(), 1.25, -0.5);
        let hand = Hand { grip: Some(Pose { position, ..Pose::IDENTITY }), tear: 0.5, ..Hand::default() };
        let wanted = Wanted { position: [0.1, 1.25, -0.5], trigger: 0.5, squeeze: 0.0, bare: false };
        assert!(wanted.matches(&hand));
        assert!(!Wanted { position: [0.1 + 1e-7, 1.25, -0.5], ..wanted }.matches(&hand));
        let (bare, fingers) = (Wanted { bare: true, ..Wanted::default() }, Hand { bare: true, ..hand });
        assert!(bare.matches(&fingers) && !bare.matches(&hand) && !wanted.matches(&fingers));
        assert!(!Wanted { trigger: 0.0, ..wanted }.matches(&hand) && !wanted.matches(&Hand { grip: None, ..hand }));
    }

    #[test]
    fn the_second_look_that_matches_is_enough() {
        let mut looks = 0;
        let seen = wait_until_seen(&[Wanted::default(); 2], || {
            looks += 1;
            let grip = (looks > 3).then_some(Pose::IDENTITY);
            Ok([Hand { grip, ..Hand::default() }; 2])
        });
        assert!(seen.is_ok() && looks == 5);
    }
}
