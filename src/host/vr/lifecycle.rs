//! The session's states, and what each asks of us (OpenXR 9.3). Pure: knows the rules, calls nobody.

use openxr::SessionState;

/// What to do now.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Order {
    /// Go on.
    None,
    /// Begin the session.
    Begin,
    /// End the session; the runtime says later whether it may start again.
    End,
    /// Destroy the session and leave: the user or the runtime wants it.
    Leave,
    /// Destroy the session and try to make another.
    Recreate,
}

/// Where a session stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Lifecycle {
    state: SessionState,
    running: bool,
}

impl Default for Lifecycle {
    fn default() -> Self {
        Self { state: SessionState::UNKNOWN, running: false }
    }
}

impl Lifecycle {
    /// Takes a state change of the runtime's.
    pub fn enter(&mut self, state: SessionState) -> Order {
        self.state = state;
        match state {
            SessionState::READY if !self.running => {
                self.running = true;
                Order::Begin
            }
            SessionState::STOPPING if self.running => {
                self.running = false;
                Order::End
            }
            SessionState::EXITING => {
                self.running = false;
                Order::Leave
            }
            SessionState::LOSS_PENDING => {
                self.running = false;
                Order::Recreate
            }
            _ => Order::None,
        }
    }

    /// True between begin and end: frames must be waited for, begun and ended.
    pub fn is_running(self) -> bool {
        self.running
    }

    /// True while the user sees our picture: the scene moves. With the headset off, it rests.
    pub fn is_seen(self) -> bool {
        self.running && matches!(self.state, SessionState::VISIBLE | SessionState::FOCUSED)
    }

    /// True while the user's hands are ours. Elsewhere (in the runtime's own menu) input is ignored and tools are put down.
    pub fn listens(self) -> bool {
        self.running && self.state == SessionState::FOCUSED
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn walk(states: &[SessionState]) -> (Lifecycle, Vec<Order>) {
        let mut life = Lifecycle::default();
        let orders = states.iter().map(|&s| life.enter(s)).filter(|&o| o != Order::None).collect();
        (life, orders)
    }

    const START: [SessionState; 5] =
        [SessionState::IDLE, SessionState::READY, SessionState::SYNCHRONIZED, SessionState::VISIBLE, SessionState::FOCUSED];

    #[test]
    fn a_session_starts_stops_and_starts_again() {
        let (life, orders) = walk(&START);
        assert!(life.listens() && life.is_seen() && life.is_running());
        assert_eq!(orders, [Order::Begin]);
        let off = [SessionState::VISIBLE, SessionState::SYNCHRONIZED, SessionState::STOPPING, SessionState::IDLE];
        let (life, orders) = walk(&[&START[..], &off, &START[1..]].concat());
        assert_eq!(orders, [Order::Begin, Order::End, Order::Begin]);
        assert!(life.listens());
    }

    #[test]
    fn focus_and_headset_are_told_apart() {
        let (life, _) = walk(&[&START[..], &[SessionState::VISIBLE]].concat());
        assert!(life.is_seen() && !life.listens(), "the runtime's menu: frames go on, input does not");
        let (life, _) = walk(&[&START[..], &[SessionState::VISIBLE, SessionState::SYNCHRONIZED]].concat());
        assert!(life.is_running() && !life.is_seen(), "headset off: the scene rests, the frame loop does not");
    }

    #[test]
    fn leaving_and_loss_end_the_loop_in_any_state() {
        for n in 0..START.len() {
            let (life, orders) = walk(&[&START[..n], &[SessionState::EXITING]].concat());
            assert!(orders.last() == Some(&Order::Leave) && !life.is_running());
            let (life, orders) = walk(&[&START[..n], &[SessionState::LOSS_PENDING]].concat());
            assert!(orders.last() == Some(&Order::Recreate) && !life.is_running());
        }
        let (life, _) = walk(&[SessionState::FOCUSED]);
        assert!(!life.listens(), "a session that has not begun does not listen, whatever the runtime says");
    }
}
