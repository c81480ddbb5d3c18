//! Zero and gain errors of the sensor that measures the board's tilt.

use pulp::Simd;

use super::{EffectSpec, Hook, Effect, Parameter, Stage};
use crate::board::Rig;
use crate::lanes::Lanes;
use crate::motion::Pair;

const fn zero(name: &'static str, means: &'static str) -> Parameter {
    Parameter {
        name,
        unit: "rad",
        range: (-0.06, 0.06),
        neutral: 0.0,
        allowed: (-1.0, 1.0),
        time_power: 0,
        optional: false,
        reach: None,
        means,
    }
}

const fn gain(name: &'static str, means: &'static str) -> Parameter {
    Parameter {
        name,
        unit: "",
        range: (0.7, 1.4),
        neutral: 1.0,
        allowed: (-100.0, 100.0),
        time_power: 2,
        optional: true,
        reach: None,
        means,
    }
}

pub(super) const ABOUT: EffectSpec = EffectSpec {
    name: "tilt_sensor",
    stage: Stage::Sensing,
    acts: Hook::OnGauge,
    hypothesis: false,
    shrunk: false,
    noise: None,
    equation: "measured tilt = gain × tilt + zero",
    parameters: &[
        zero("zero_x_rad", "measured tilt about x of a board that is level"),
        zero("zero_y_rad", "measured tilt about y of a board that is level"),
        gain("gain_x", "change of the measured tilt about x per radian of tilt"),
        gain("gain_y", "change of the measured tilt about y per radian of tilt"),
    ],
    does: "The tilt sensor, markers under a camera or an inertial unit, is not aligned with the board and has a scale error. \
           The marble's motion and its picture do not change.",
    matters: "Wherever a measured tilt is compared with the tilt that moves the marble. Zeros of 20 to 50 mrad are common.",
    looks: "The marble rests, or rolls at constant speed, at a measured tilt that is not zero. Its acceleration is \
            proportional to the measured tilt, but with a factor other than 5/7 g.",
    references: &["Ljung: System Identification, 2nd ed., sect. 14.1 (offsets)"],
};

#[derive(Clone)]
pub(crate) struct TiltSensor<S: Simd> {
    zero: Pair<S>,
    gain: Pair<S>,
}

impl<S: Simd> Effect<S> for TiltSensor<S> {
    fn new(_: S, _: &Rig, values: &[Lanes<S>]) -> Self {
        Self {
            zero: [values[0], values[1]],
            gain: [values[2], values[3]],
        }
    }

    #[inline(always)]
    fn gauge(&self, tilt: &mut Pair<S>) {
        for (axis, tilt) in tilt.iter_mut().enumerate() {
            *tilt = self.gain[axis] * *tilt + self.zero[axis];
        }
    }
}

#[cfg(test)]
mod tests {
    use pulp::Scalar;

    use super::*;

    fn measured(values: &[f64], tilt: [f64; 2]) -> [f64; 2] {
        let lanes = |value: f64| Lanes::splat(Scalar, value);
        let values: Vec<Lanes<Scalar>> = values.iter().map(|&value| lanes(value)).collect();
        let sensor = TiltSensor::new(Scalar, &Rig::default(), &values);
        let mut tilt = tilt.map(lanes);
        sensor.gauge(&mut tilt);
        tilt.map(|tilt| tilt.to_array()[0])
    }

    #[test]
    fn at_neutral_values_the_measured_tilt_is_the_tilt() {
        assert_eq!(measured(&ABOUT.neutral(), [0.031, -0.27]), [0.031, -0.27]);
    }

    #[test]
    fn each_axis_has_its_own_zero_and_gain() {
        let found = measured(&[0.05, -0.02, 0.5, 2.0], [0.25, -0.125]);
        assert_eq!(found, [0.175, -0.27]);
    }
}
