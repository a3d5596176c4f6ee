//! Adjusts the positions of reference pictures to all links between them.
//!
//! A tree of links gives each reference a position. When the camera comes back, further links close loops, in which the
//! errors of the links add up. The adjustment spreads such an error over the loop. It minimises the weighted squared
//! distances between the points that each link maps and the same points by the positions of its two references. Each
//! step fits one reference to its neighbours (Gauss–Seidel).

use std::collections::BTreeMap;

use nalgebra::Vector2;
use roadplane_base::{Homography, ImageSize, bbox_grid};

use crate::MOST_ROUNDS;

/// A measured mapping between two references.
#[derive(Clone, Copy, Debug)]
pub(crate) struct MeasuredLink {
    /// The two references.
    pub ends: [u64; 2],
    /// Mapping from pixels of the first reference to pixels of the second.
    pub mapping: Homography,
    /// Inverse of the variance of a mapped point, 1/px².
    pub weight: f64,
}

/// Change of a point in one pass below which the adjustment ends, px.
const STILL_PX: f64 = 1e-3;

/// Returns the adjusted positions. A position is the mapping from the world picture to the reference, px. The world
/// picture is the reference `world`, which keeps its position.
///
/// Links without loops agree with the tree, so the positions stay as they are.
pub(crate) fn adjusted(
    positions: BTreeMap<u64, Homography>,
    links: &[MeasuredLink],
    world: u64,
    size: ImageSize,
) -> BTreeMap<u64, Homography> {
    let is_here = |link: &&MeasuredLink| link.ends.iter().all(|end| positions.contains_key(end));
    let links: Vec<MeasuredLink> = links.iter().filter(is_here).copied().collect();
    if links.len() < positions.len() {
        return positions;
    }
    let mut adjusted = positions;
    let references: Vec<u64> = adjusted.keys().copied().filter(|reference| *reference != world).collect();
    for _ in 0..MOST_ROUNDS {
        let mut change_px: f64 = 0.0;
        for reference in &references {
            if let Some(fitted) = fitted(*reference, &adjusted, &links, size) {
                let moved = adjusted[reference].inverse().then(&fitted);
                change_px = change_px.max(moved.displacement(&size.picture_px()));
                adjusted.insert(*reference, fitted);
            }
        }
        if change_px < STILL_PX {
            break;
        }
    }
    adjusted
}

/// Fits a reference to the positions of its neighbours. Returns `None` if they do not determine it.
fn fitted(
    reference: u64,
    positions: &BTreeMap<u64, Homography>,
    links: &[MeasuredLink],
    size: ImageSize,
) -> Option<Homography> {
    let unit = f64::from(size.width) / 2.0;
    let centre = size.centre_px();
    let scaled = |point: Vector2<f64>| (point - centre) / unit;
    let world_from_reference = positions[&reference].inverse();
    let grid: Vec<Vector2<f64>> =
        bbox_grid(&size.picture_px()).map(|point| world_from_reference.apply(&point)).collect();
    let by_link = links.iter().filter_map(|link| {
        let [from, to] = link.ends;
        let (neighbour, mapping) = if reference == to {
            (from, link.mapping)
        } else if reference == from {
            (to, link.mapping.inverse())
        } else {
            return None;
        };
        Some((positions[&neighbour].then(&mapping), link.weight))
    });
    let pairs = by_link.flat_map(|(predicted, weight)| {
        grid.iter().map(move |point| (scaled(*point), scaled(predicted.apply(point)), weight))
    });
    let (fitted, _) = Homography::fit(pairs, None)?;
    Some(fitted.in_coordinates(unit, Vector2::zeros()).in_coordinates(1.0, centre))
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix3, Rotation3};

    const SIZE: ImageSize = ImageSize { width: 1280, height: 720 };

    /// Returns the mapping from the world picture to the picture of a camera that is turned to the right, px.
    fn turned(pan: f64) -> Homography {
        let k = Matrix3::new(1500.0, 0.0, 639.5, 0.0, 1500.0, 359.5, 0.0, 0.0, 1.0);
        let rotation = Rotation3::from_euler_angles(0.0, -pan, 0.0);
        Homography::new(k * rotation.matrix() * k.try_inverse().unwrap()).unwrap()
    }

    /// Returns a mapping with an error that depends on a number.
    fn with_error(mapping: &Homography, number: f64) -> Homography {
        let noise =
            |k: f64| 2.0 * ((number * 12.9898 + k * 78.233).sin() * 43_758.545_3).rem_euclid(1.0) - 1.0;
        let wrong = Homography::from_numbers([
            1.0 + 3e-4 * noise(1.0),
            3e-4 * noise(2.0),
            0.3 * noise(3.0),
            3e-4 * noise(4.0),
            1.0 + 3e-4 * noise(5.0),
            0.3 * noise(6.0),
            0.0,
            0.0,
        ]);
        mapping.then(&wrong.unwrap())
    }

    fn error_px(positions: &BTreeMap<u64, Homography>) -> f64 {
        let of = |(reference, position): (&u64, &Homography)| {
            let truth = turned(0.1 * *reference as f64);
            truth.inverse().then(position).displacement(&SIZE.picture_px())
        };
        positions.iter().map(of).fold(0.0, f64::max)
    }

    /// Returns the greatest error of the chain's tree and of the adjusted positions, px.
    fn errors_px(seed: f64) -> [f64; 2] {
        let link = |from: u64, to: u64| {
            let exact = turned(0.1 * from as f64).inverse().then(&turned(0.1 * to as f64));
            let mapping = with_error(&exact, 100.0 * seed + (7 * from + to) as f64);
            MeasuredLink { ends: [from, to], mapping, weight: 4.0 }
        };
        let chain: Vec<MeasuredLink> = (0..5).map(|i| link(i, i + 1)).collect();
        let mut tree = BTreeMap::from([(0, Homography::IDENTITY)]);
        for link in &chain {
            let position = tree[&link.ends[0]].then(&link.mapping);
            tree.insert(link.ends[1], position);
        }
        let same = adjusted(tree.clone(), &chain, 0, SIZE);
        assert_eq!(same, tree, "a chain without loops keeps its positions");
        let all: Vec<MeasuredLink> =
            chain.into_iter().chain((0..4).map(|i| link(i, i + 2))).chain([link(0, 3), link(1, 5)]).collect();
        let better = adjusted(tree.clone(), &all, 0, SIZE);
        assert_eq!(better[&0], Homography::IDENTITY);
        [error_px(&tree), error_px(&better)]
    }

    #[test]
    fn loops_reduce_the_error_of_a_chain() {
        let errors: Vec<[f64; 2]> = (0..40).map(|seed| errors_px(f64::from(seed))).collect();
        let [tree, better] = [0, 1].map(|i| errors.iter().map(|e| e[i] * e[i]).sum::<f64>().sqrt());
        assert!(better < 0.8 * tree, "{better} {tree}");
    }
}
