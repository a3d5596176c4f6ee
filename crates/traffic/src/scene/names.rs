//! Names of arms.

use std::f64::consts::TAU;

use nalgebra::Vector2;

const COMPASS: [&str; 8] = ["N", "NE", "E", "SE", "S", "SW", "W", "NW"];

/// Returns the order of arms, clockwise from the viewing direction around their centre, and their names in that order.
/// `arms` has the middle of each gate and the direction out of the scene. `north_rad` is the bearing of the world's y
/// axis, clockwise from north.
pub(super) fn named(arms: &[(Vector2<f64>, Vector2<f64>)], north_rad: Option<f64>) -> Vec<(usize, String)> {
    let centre = arms.iter().map(|arm| arm.0).sum::<Vector2<f64>>() / arms.len().max(1) as f64;
    let clockwise = |v: Vector2<f64>| v.x.atan2(v.y).rem_euclid(TAU);
    let mut order: Vec<(usize, f64)> =
        arms.iter().enumerate().map(|(i, arm)| (i, clockwise(arm.0 - centre))).collect();
    order.sort_by(|a, b| a.1.total_cmp(&b.1));
    let Some(north_rad) = north_rad else {
        return order.iter().enumerate().map(|(k, &(i, _))| (i, (k + 1).to_string())).collect();
    };
    let point = |i: usize| {
        let bearing = (clockwise(arms[i].1) + north_rad).rem_euclid(TAU);
        COMPASS[(bearing / TAU * 8.0).round() as usize % 8]
    };
    let name = |k: usize| {
        let here = point(order[k].0);
        let same = |range: std::ops::Range<usize>| {
            order[range].iter().filter(|other| point(other.0) == here).count()
        };
        if same(0..order.len()) == 1 { here.to_owned() } else { format!("{here}{}", same(0..k + 1)) }
    };
    (0..order.len()).map(|k| (order[k].0, name(k))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arms_are_numbered_clockwise_or_named_by_the_compass() {
        let arm = |x: f64, y: f64| (Vector2::new(x, y), Vector2::new(x, y) / x.hypot(y));
        let arms = [arm(-10.0, 0.1), arm(10.0, 0.0), arm(-0.1, 10.0), arm(0.0, -10.0)];
        let numbered: Vec<_> = named(&arms, None);
        assert_eq!(
            numbered.iter().map(|(i, name)| (*i, name.as_str())).collect::<Vec<_>>(),
            [(1, "1"), (3, "2"), (0, "3"), (2, "4")]
        );
        let names = |north_rad| {
            let mut named = named(&arms, Some(north_rad));
            named.sort();
            named.into_iter().map(|(_, name)| name).collect::<Vec<_>>()
        };
        assert_eq!(names(0.0), ["W", "E", "N", "S"]);
        assert_eq!(names(90_f64.to_radians()), ["N", "S", "E", "W"]);
        let two = [arm(10.0, 1.0), arm(10.0, -1.0)];
        assert_eq!(named(&two, Some(0.0)), [(0, "E1".to_owned()), (1, "E2".to_owned())]);
        assert!(named(&[], Some(0.0)).is_empty());
    }
}
