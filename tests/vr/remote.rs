//! A client of Monado's `remote` driver: head and controllers as 376 bytes, little endian; the latest packet wins.

use glam::DQuat;
use std::io::{Read, Write};
use std::net::TcpStream;

const PACKET: usize = 376;

/// One controller.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Controller {
    pub position: [f32; 3],
    /// To the left about the vertical, then down about the hand's own x: radians.
    pub turn: [f32; 2],
    pub trigger: f32,
    pub squeeze: f32,
    /// Stick to the right, -1 to 1.
    pub stick: f32,
    /// The stick, pressed.
    pub stick_down: bool,
    /// Nothing is held: the fingers are tracked, and pinch as far as the trigger says.
    pub bare: bool,
    /// The lower button of the hand.
    pub a: bool,
    /// The upper one.
    pub b: bool,
}

impl Controller {
    pub fn rotation(&self) -> DQuat {
        DQuat::from_rotation_y(self.turn[0].into()) * DQuat::from_rotation_x(f64::from(-self.turn[1]))
    }
}

pub struct Remote(TcpStream);

impl Remote {
    pub fn connect(port: u16) -> std::io::Result<Self> {
        let mut stream = TcpStream::connect(("127.0.0.1", port))?;
        stream.set_nodelay(true)?;
        // it greets with its reset state and its latest state
        stream.read_exact(&mut [0; 2 * PACKET])?;
        Ok(Self(stream))
    }

    /// `pitch`: how far the head looks down, radians.
    pub fn send(&mut self, head: [f32; 3], pitch: f32, hands: &[Controller; 2]) -> std::io::Result<()> {
        let mut bytes = Vec::with_capacity(PACKET);
        bytes.extend_from_slice(b"mndrmt3\0");
        bytes.extend_from_slice(&[0; 96]); // views of their own: none
        put(&mut bytes, &[-(0.5 * pitch).sin(), 0.0, 0.0, (0.5 * pitch).cos()]);
        put(&mut bytes, &head);
        bytes.extend_from_slice(&[0; 4]);
        for hand in hands {
            put(&mut bytes, &hand.rotation().as_quat().to_array());
            put(&mut bytes, &hand.position);
            put(&mut bytes, &[0.0; 6]); // velocities
            // little, ring and middle finger, index finger and thumb: curled so, the tips of the two meet
            put(&mut bytes, &if hand.bare { [0.0, 0.0, 0.0, hand.trigger, 0.95 * hand.trigger] } else { [0.0; 5] });
            put(&mut bytes, &[hand.trigger, hand.squeeze, hand.squeeze, hand.stick, 0.0, 0.0, 0.0, 0.0]);
            let on = |b: bool| u8::from(b);
            // hand tracking, active, system, a, b, trigger, stick: clicked and touched each; trackpad, padding
            let (pulled, touched) = (on(hand.trigger > 0.9), on(hand.trigger > 0.0));
            bytes.extend_from_slice(&[
                on(hand.bare),
                on(!hand.bare),
                0,
                0,
                on(hand.a),
                on(hand.a),
                on(hand.b),
                on(hand.b),
                pulled,
                touched,
            ]);
            bytes.extend_from_slice(&[on(hand.stick_down), on(hand.stick_down), 0, 0, 0, 0]);
        }
        assert_eq!(bytes.len(), PACKET);
        self.0.write_all(&bytes)
    }
}

fn put(bytes: &mut Vec<u8>, numbers: &[f32]) {
    numbers.iter().for_each(|n| bytes.extend_from_slice(&n.to_le_bytes()));
}
