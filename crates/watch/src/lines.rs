//! Straight edges of the scene that may be vertical: masts, corners of houses, door frames.
//!
//! Segments come from OpenCV's line segment detector (LSD: Grompone von Gioi et al., IPOL 2012). It returns only
//! segments that are unlikely to arise by chance. Pieces of one edge are joined. Then a line is fitted to the points of
//! steepest change along every edge ([`Edges`](crate::edges::Edges)). This fit also gives the uncertainty of the edge's
//! direction.

use image::RgbImage;
use nalgebra::Vector2;
use opencv::core::{Mat, Ptr, Size, Vec3b, Vec4f, Vector};
use opencv::imgproc::{
    COLOR_RGB2GRAY, LineSegmentDetector, LineSegmentDetectorTrait as _, create_line_segment_detector_def,
    cvt_color_def, gaussian_blur_def,
};
use roadplane_base::SceneLine;

use crate::WatchError;
use crate::edges::Edges;

/// Largest angle between an edge and the picture's vertical, rad. A plausible camera shows no vertical object at a
/// larger angle. For example, a mast at the side of a picture 60° wide leans by 25° if the camera looks down by 40°.
const MAX_LEAN: f64 = 0.52;
/// Smallest length of an edge, as a share of the picture's longer side.
const MIN_SHARE: f64 = 0.015;
/// Smallest length of an edge, px. The larger of this limit and [`MIN_SHARE`] applies.
const MIN_PX: f64 = 15.0;
/// Margin at the left and right border of the picture, as a share of the picture's longer side. An edge within this
/// margin may be the border itself.
const RIM_SHARE: f64 = 0.008;
/// Margin around a vehicle's box, as a share of the box's longer side.
const BOX_SHARE: f64 = 0.05;
/// A piece is joined to a longer piece if its ends lie within this distance of the longer piece's line, px.
const JOIN_PX: f64 = 1.0;
/// Largest gap between two pieces that are joined, as a share of the longer piece.
const JOIN_GAP: f64 = 0.5;
/// Largest number of edges that are kept, the longest first.
const MOST: usize = 120;
/// Largest number of neighbouring edges that are kept. A facade can have hundreds of edges with the same information.
const CROWD: usize = 6;
/// Distance below which two edges are neighbours, as a share of the picture's longer side.
const CROWD_SHARE: f64 = 0.03;
/// Standard deviation of the Gaussian blur before lines are fitted to edges, px.
const BLUR_PX: f64 = 0.8;

/// A piece of an edge. The order of its two ends shows which side of it is darker.
#[derive(Clone, Copy, Debug)]
struct Piece {
    ends: [Vector2<f64>; 2],
}

impl Piece {
    fn along(&self) -> Vector2<f64> {
        self.ends[1] - self.ends[0]
    }

    fn length(&self) -> f64 {
        self.along().norm()
    }

    /// Joins this piece with a shorter piece of the same edge. Returns `None` unless both lie on one line, have the
    /// same darker side, and have no large gap between them.
    fn joined(&self, other: &Self) -> Option<Self> {
        let length = self.length();
        let along = self.along() / length;
        if along.dot(&other.along()) <= 0.0 {
            return None;
        }
        let from = other.ends.map(|end| end - self.ends[0]);
        let is_near = from.iter().all(|end| along.perp(end).abs() <= JOIN_PX);
        let [first, last] = from.map(|end| along.dot(&end));
        let gap = (first - length).max(-last);
        (is_near && gap <= JOIN_GAP * length).then(|| {
            let ends = [first.min(0.0), last.max(length)].map(|at| self.ends[0] + at * along);
            Self { ends }
        })
    }
}

/// Finds straight edges in a picture that may be vertical in the world, the longest first.
///
/// `boxes` are the boxes of vehicles: left, top, right, bottom, px. Edges in a box are left out.
///
/// # Errors
/// [`WatchError`] when OpenCV fails.
pub fn scene_lines(image: &RgbImage, boxes: &[[f64; 4]]) -> Result<Vec<SceneLine>, WatchError> {
    let side = |length: u32| i32::try_from(length).unwrap_or(i32::MAX);
    let pixels =
        Mat::new_rows_cols_with_bytes::<Vec3b>(side(image.height()), side(image.width()), image.as_raw())?;
    let mut grey = Mat::default();
    cvt_color_def(&pixels, &mut grey, COLOR_RGB2GRAY)?;
    let longer = f64::from(image.width().max(image.height()));
    let least = (MIN_SHARE * longer).max(MIN_PX);
    let may_be_part = |piece: &Piece| {
        let along = piece.along();
        let rim = RIM_SHARE * longer;
        let is_inside =
            piece.ends.iter().all(|end| end.x > rim && end.x < f64::from(image.width()) - 1.0 - rim);
        let middle = (piece.ends[0] + piece.ends[1]) / 2.0;
        // Short pieces are kept at first, because they may be joined to longer ones.
        is_inside
            && along.x.abs() < MAX_LEAN.tan() * along.y.abs()
            && !boxes.iter().any(|b| is_in(b, &middle))
    };
    let mut pieces: Vec<Piece> = detected(&grey)?.into_iter().filter(may_be_part).collect();
    pieces.retain(|piece| piece.length() >= 0.5 * least);
    pieces.sort_by(|a, b| b.length().total_cmp(&a.length()));
    let mut blurred = Mat::default();
    gaussian_blur_def(&grey, &mut blurred, Size::new(0, 0), BLUR_PX)?;
    let edges = Edges::of(&blurred)?;
    let mut lines: Vec<SceneLine> = Vec::new();
    for piece in joined(pieces).into_iter().filter(|piece| piece.length() >= least) {
        let Some(line) = edges.refitted(&piece.ends) else { continue };
        let near = |other: &&SceneLine| (other.middle_px() - line.middle_px()).norm() < CROWD_SHARE * longer;
        if lines.iter().filter(near).count() < CROWD {
            lines.push(line.rounded());
        }
        if lines.len() == MOST {
            break;
        }
    }
    Ok(lines)
}

fn detected(grey: &Mat) -> Result<Vec<Piece>, WatchError> {
    let mut detector: Ptr<LineSegmentDetector> = create_line_segment_detector_def()?;
    let mut found = Vector::<Vec4f>::new();
    detector.detect_def(grey, &mut found)?;
    let piece = |ends: Vec4f| {
        let [x0, y0, x1, y1] = ends.0.map(f64::from);
        Piece { ends: [Vector2::new(x0, y0), Vector2::new(x1, y1)] }
    };
    Ok(found.iter().map(piece).filter(|piece| piece.length() > 1.0).collect())
}

/// Whether a point is in a vehicle's box or in a small margin around the box.
pub(crate) fn is_in(bbox_px: &[f64; 4], at: &Vector2<f64>) -> bool {
    let [x0, y0, x1, y1] = *bbox_px;
    let more = BOX_SHARE * (x1 - x0).max(y1 - y0);
    (x0 - more..x1 + more).contains(&at.x) && (y0 - more..y1 + more).contains(&at.y)
}

/// Joins the pieces of each edge. The pieces must be sorted from long to short, and so is the result.
fn joined(mut pieces: Vec<Piece>) -> Vec<Piece> {
    let mut i = 0;
    while i < pieces.len() {
        let with = (i + 1..pieces.len()).find_map(|k| Some((k, pieces[i].joined(&pieces[k])?)));
        match with {
            Some((k, whole)) => {
                pieces.remove(k);
                pieces[i] = whole;
            }
            None => i += 1,
        }
    }
    pieces.sort_by(|a, b| b.length().total_cmp(&a.length()));
    pieces
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Draws grey masts with soft borders on a lighter ground. The ground has a horizontal kerb, which is no candidate.
    fn drawn(masts: &[(Vector2<f64>, Vector2<f64>)]) -> RgbImage {
        RgbImage::from_fn(960, 540, |x, y| {
            let at = Vector2::new(f64::from(x), f64::from(y));
            let mut value = if y > 400 { 170.0 } else { 150.0 };
            for (top, foot) in masts {
                let along = (foot - top) / (foot - top).norm();
                let from = at - top;
                let length = (foot - top).norm();
                if (0.0..length).contains(&along.dot(&from)) {
                    // The mast is 8 px wide, and its borders are blurred over one pixel.
                    let inside = (4.5 - along.perp(&from).abs()).clamp(0.0, 1.0);
                    value += inside * (60.0 - value);
                }
            }
            let noise = f64::from((x.wrapping_mul(7919) ^ y.wrapping_mul(104_729)) % 7) - 3.0;
            let v = (value + noise).round() as u8;
            image::Rgb([v, v, v])
        })
    }

    #[test]
    fn both_rims_of_a_mast_are_found_to_a_fraction_of_a_degree() {
        let masts = [
            (Vector2::new(200.3, 90.0), Vector2::new(215.8, 330.0)),
            (Vector2::new(600.0, 60.0), Vector2::new(588.5, 260.0)),
        ];
        let lines = scene_lines(&drawn(&masts), &[]).unwrap();
        assert_eq!(lines.len(), 4, "{lines:?}");
        for line in &lines {
            let (top, foot) = masts[usize::from(line.middle_px().x > 400.0)];
            let (mast, found) = (foot - top, line.along_px());
            let off = mast.perp(&found).abs() / (mast.norm() * found.norm());
            assert!(off < 0.002 && off < 4.0 * line.sd_rad && line.sd_rad < 0.003, "{off} {line:?}");
        }
    }

    #[test]
    fn vehicles_and_horizontal_edges_are_left_out() {
        let mast = (Vector2::new(300.0, 90.0), Vector2::new(300.0, 330.0));
        let flat = (Vector2::new(400.0, 300.0), Vector2::new(800.0, 320.0));
        assert!(scene_lines(&drawn(&[mast, flat]), &[[250.0, 80.0, 350.0, 340.0]]).unwrap().is_empty());
        assert!(scene_lines(&RgbImage::new(3, 2), &[]).unwrap().is_empty());
    }

    #[test]
    fn pieces_of_one_edge_are_joined() {
        let piece = |y0: f64, y1: f64, x: f64| Piece { ends: [Vector2::new(x, y0), Vector2::new(x, y1)] };
        let whole = joined(vec![piece(0.0, 60.0, 10.0), piece(70.0, 100.0, 10.4), piece(70.0, 95.0, 16.0)]);
        assert_eq!(whole.len(), 2);
        assert!((whole[0].length() - 100.0).abs() < 0.1);
        let other_side = piece(100.0, 70.0, 10.4);
        assert!(piece(0.0, 60.0, 10.0).joined(&other_side).is_none());
    }
}
