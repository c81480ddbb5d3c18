//! Pictures of a marble from above, cut out of a picture of the board.

/// Pixels of a cut along each edge, as learners of the `CyberRunner` take them.
pub const CUT: usize = 64;

/// Colour of the marble: steel.
const STEEL: [f64; 3] = [190.0, 196.0, 204.0];

/// A picture of the board without its marble; its middle is the board's, and y points upwards.
#[derive(Debug, Clone)]
pub struct Scene {
    /// Colours, row by row from the top.
    pub pixels: Vec<[u8; 3]>,
    /// Pixels of a row.
    pub width: usize,
    /// Pixels to a metre.
    pub per_m: f64,
    /// Radius of the marble (m).
    pub radius_m: f64,
}

impl Scene {
    /// Paints what is around a marble at a place (m from the board's centre) into `out`, [`CUT`] squared pixels
    /// from the top; black beyond the board, and everywhere where there is no place.
    pub fn cut(&self, place: [f64; 2], out: &mut [[u8; 3]]) {
        out.fill([0; 3]);
        if !(place[0].is_finite() && place[1].is_finite()) || self.width == 0 {
            return;
        }
        let (width, height) = (self.width as f64, (self.pixels.len() / self.width) as f64);
        // Where the marble is, in pixels from the upper left corner of the picture.
        let (x, y) = (
            place[0] * self.per_m + 0.5 * width,
            0.5 * height - place[1] * self.per_m,
        );
        let (size, half) = (CUT as f64, (CUT / 2) as f64);
        let (left, top) = (x.round() - half, y.round() - half);
        let [begin, end] = [-left, width - left].map(|edge| edge.clamp(0.0, size) as usize);
        for (row, line) in out.chunks_exact_mut(CUT).enumerate() {
            let from = top + row as f64;
            if begin < end && from >= 0.0 && from < height {
                let first = from as usize * self.width + (left + begin as f64) as usize;
                line[begin..end].copy_from_slice(&self.pixels[first..first + end - begin]);
            }
        }
        self.marble([x - left, y - top], out);
    }

    /// Paints the marble at a place of a cut (pixels from its upper left corner).
    fn marble(&self, [x, y]: [f64; 2], out: &mut [[u8; 3]]) {
        let radius = self.radius_m * self.per_m;
        let span = |middle: f64| {
            let low = (middle - radius - 1.0).max(0.0) as usize;
            low.min(CUT)..((middle + radius + 2.0).max(0.0) as usize).min(CUT)
        };
        for row in span(y) {
            for column in span(x) {
                let (dx, dy) = (column as f64 + 0.5 - x, row as f64 + 0.5 - y);
                // How much of the pixel the disc covers, but for its corners.
                let part = (radius + 0.5 - dx.hypot(dy)).clamp(0.0, 1.0);
                let pixel = &mut out[row * CUT + column];
                for (one, steel) in pixel.iter_mut().zip(STEEL) {
                    let colour = f64::from(*one);
                    *one = (colour + part * (steel - colour)).round() as u8;
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scene() -> Scene {
        let (width, height) = (100, 80);
        let pixels = (0..width * height)
            .map(|i| [(i % width) as u8, (i / width) as u8, 7])
            .collect();
        Scene {
            pixels,
            width,
            per_m: 1000.0,
            radius_m: 0.006,
        }
    }

    fn cut(place: [f64; 2]) -> Vec<[u8; 3]> {
        let mut out = vec![[9; 3]; CUT * CUT];
        scene().cut(place, &mut out);
        out
    }

    #[test]
    fn the_board_lies_around_the_marble_as_it_does_in_the_picture() {
        // 50 and 40 are the middle; 10 mm to the right, and 5 mm up.
        let out = cut([0.010, 0.005]);
        assert_eq!(out[0], [60 - 32, 35 - 32, 7]);
        assert_eq!(out[CUT - 1], [60 + 31, 35 - 32, 7]);
        assert_eq!(out[CUT * CUT - 1], [60 + 31, 35 + 31, 7]);
    }

    #[test]
    fn beyond_the_board_it_is_black() {
        let out = cut([0.045, 0.0]);
        assert_eq!(out[32 * CUT + CUT - 1], [0; 3]);
        assert_eq!(out[0], [95 - 32, 40 - 32, 7]);
        assert!(cut([f64::NAN, 0.0]).iter().all(|&pixel| pixel == [0; 3]));
        assert!(cut([9.0, 9.0])[0] == [0; 3]);
    }

    #[test]
    fn the_marble_covers_its_disc() {
        for place in [[0.0, 0.0], [0.0004, -0.0003], [0.01, 0.02]] {
            let steel = |pixel: &&[u8; 3]| pixel[2] > 7;
            let covered: f64 = cut(place)
                .iter()
                .filter(steel)
                .map(|pixel| f64::from(pixel[2] - 7) / (STEEL[2] - 7.0))
                .sum();
            let area = std::f64::consts::PI * 6.0_f64.powi(2);
            assert!((covered - area).abs() < 0.03 * area, "{covered} of {area}");
        }
    }
}
