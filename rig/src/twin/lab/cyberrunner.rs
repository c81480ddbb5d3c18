//! A `CyberRunner`'s topics and service, from the rig's side.

use labsim::scene::CUT;
use ros2_client::service::RmwRequestId;
use ros2_client::{Server, ServiceTypeName};

use super::Asked;
use super::eye::Sight;
use crate::clock::Clock;
use crate::config::Reliability;
use crate::dds::{Inbox, Link, Outlet};
use crate::error::Result;
use crate::frames;
use crate::labs::config::TwinConfig;
use crate::labs::{COMMANDS, ESTIMATE_SUBIMG, ESTIMATES, Lab, RESET};
use crate::messages::{
    DynamixelVel, Header, Image, ResetRequest, ResetResponse, StateEstimate, StateEstimateSub,
    TfMessage, Time,
};

/// Topics and service.
pub struct Front {
    commands: Inbox<DynamixelVel>,
    pictured: Outlet<StateEstimateSub>,
    plain: Vec<Outlet<StateEstimate>>,
    frames: Outlet<TfMessage>,
    reset: Server<ResetRequest, ResetResponse>,
    /// Requests that wait for the board to be level.
    asked: Vec<RmwRequestId>,
    clock: Clock,
    /// Holds the node.
    _link: Link,
}

impl Front {
    /// Joins the network.
    ///
    /// # Errors
    /// [`Error::Refused`](crate::error::Error::Refused) if DDS does not allow it.
    pub fn open(config: &TwinConfig) -> Result<Self> {
        let mut link = Link::open(&config.network, "cyberrunner_twin")?;
        let kind = ServiceTypeName::new("cyberrunner_interfaces", "DynamixelReset");
        Ok(Self {
            commands: link.subscribe(COMMANDS, Reliability::BestEffort)?,
            pictured: link.publish(ESTIMATE_SUBIMG, Reliability::Reliable)?,
            plain: ESTIMATES
                .iter()
                .map(|topic| link.publish(topic, Reliability::Reliable))
                .collect::<Result<_>>()?,
            frames: link.publish("/tf", Reliability::Reliable)?,
            reset: link.offer(RESET, &kind)?,
            asked: Vec::new(),
            clock: Clock::new(),
            _link: link,
        })
    }

    /// What came since the last tick.
    pub fn hear(&mut self) -> Asked {
        let mut asked = Asked::default();
        self.commands.drain(self.clock, |_, message| {
            asked.commands = Some([message.vel_1, message.vel_2]);
        });
        while let Ok(Some((id, _))) = self.reset.receive_request() {
            self.asked.push(id);
            asked.reset = true;
        }
        asked
    }

    /// Answers the requests for a reset: the board is level.
    pub fn answer_resets(&mut self) {
        for id in self.asked.drain(..) {
            let _ = self.reset.send_response(id, ResetResponse { success: 1 });
        }
    }

    /// Publishes what the estimator reports.
    ///
    /// # Errors
    /// [`Error::Refused`](crate::error::Error::Refused) if DDS does not take it.
    pub fn show(&mut self, sight: &Sight) -> Result<()> {
        let ([alpha, beta], [x_b, y_b]) = (sight.seen.angles(), sight.seen.place_m);
        let [x_b_dot, y_b_dot] = sight.velocity;
        let state = StateEstimate {
            x_b,
            y_b,
            x_b_dot,
            y_b_dot,
            alpha,
            beta,
        };
        for outlet in &self.plain {
            outlet.send(state)?;
        }
        let stamp = Time::from_nanos(self.clock.now().nanos);
        let mut transforms = vec![frames::board(stamp, sight.seen.tilts)];
        if sight.seen.has_marble() {
            let radius = Lab::Cyberrunner.size().radius_m;
            transforms.push(frames::marble(stamp, sight.seen.place_m, radius));
        }
        self.frames.send(TfMessage { transforms })?;
        self.pictured.send(StateEstimateSub {
            state,
            subimg: image(&sight.picture),
        })
    }
}

/// A picture as the lab's camera and `cv_bridge` have it: blue first, without a stamp.
fn image(picture: &[[u8; 3]]) -> Image {
    Image {
        header: Header::default(),
        height: CUT as u32,
        width: CUT as u32,
        encoding: "8UC3".to_owned(),
        is_bigendian: 0,
        step: 3 * CUT as u32,
        data: picture
            .iter()
            .flat_map(|&[red, green, blue]| [blue, green, red])
            .collect(),
    }
}
