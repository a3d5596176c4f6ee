//! Tests which changes count, and which pixels enter the background.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

use std::sync::LazyLock;

use image::{Rgb, RgbImage};
use nalgebra::Vector2;
use proptest::prelude::*;
use roadplane_base::{Homography, ImageSize, Lens, PictureMotion};
use roadplane_watch::{Background, CELL_PX, Cells, ChangeMap, SmallGrey, View};

const WIDTH: usize = 164;
const HEIGHT: usize = 90;

/// Returns the view of a picture that is shifted by this many px of the reduced picture.
fn view(shift: Vector2<f64>) -> View {
    let size = ImageSize { width: 2 * WIDTH as u32, height: 2 * HEIGHT as u32 };
    let [x, y] = [2.0 * shift.x, 2.0 * shift.y];
    let mapping = Homography::from_numbers([1.0, 0.0, x, 0.0, 1.0, y, 0.0, 0.0]).unwrap();
    View::new(Some(0), PictureMotion::new(mapping, Lens::STRAIGHT, size), size)
}

fn at_rest() -> View {
    view(Vector2::zeros())
}

/// Returns the texture's grey level at a point, 40–200.
fn texture(x: f64, y: f64) -> f64 {
    120.0
        + 30.0 * (x * 0.31 + (y * 0.11).sin()).sin()
        + 30.0 * (y * 0.37 - x * 0.05).cos()
        + 20.0 * (x * 0.06).sin()
}

fn clean(shift: Vector2<f64>) -> Vec<f64> {
    let at = |i: usize| texture((i % WIDTH) as f64 - shift.x, (i / WIDTH) as f64 - shift.y);
    (0..WIDTH * HEIGHT).map(at).collect()
}

/// Returns the textured scene, shifted by `shift`, with noise of at most `noise` grey levels.
fn scene(shift: Vector2<f64>, noise: f64, seed: u64) -> SmallGrey {
    let mut state = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1;
    let mut dice = || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 40) as f64 / f64::from(1 << 23) - 1.0
    };
    static AT_REST: LazyLock<Vec<f64>> = LazyLock::new(|| clean(Vector2::zeros()));
    let shifted = (shift.norm() > 0.0).then(|| clean(shift));
    let clean = shifted.as_ref().unwrap_or(&AT_REST);
    let values = clean.iter().map(|value| (value + noise * dice()).round() as u8).collect();
    SmallGrey { width: WIDTH, height: HEIGHT, factor: 2, values }
}

/// Adds a fine texture of this strength (grey levels) to the cells in columns 5–8 and rows 3–5.
fn with_block(mut picture: SmallGrey, strength: i32) -> SmallGrey {
    for y in 3 * CELL_PX..6 * CELL_PX {
        for x in 5 * CELL_PX..9 * CELL_PX {
            let value = &mut picture.values[y * WIDTH + x];
            *value =
                (i32::from(*value) + if (x + y) % 2 == 0 { strength } else { -strength }).clamp(0, 255) as u8;
        }
    }
    picture
}

fn the_block(map: &ChangeMap) -> Cells {
    let mut cells = map.no_cells();
    for row in 3..6 {
        (5..9).for_each(|column| cells.insert(column, row));
    }
    cells
}

/// Returns a map that has learnt the scene's noise, and the time of its next picture, s.
fn learned(noise: f64, seed: u64) -> (ChangeMap, f64) {
    let mut map = ChangeMap::new(&scene(Vector2::zeros(), noise, seed));
    for i in 0..40 {
        map.changed(&scene(Vector2::zeros(), noise, seed + 1 + i), &at_rest(), i as f64 * 0.1);
    }
    (map, 4.0)
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 24, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn noise_alone_changes_nothing(noise in 0.0_f64..8.0, seed in 0_u64..1000) {
        let (mut map, start_s) = learned(noise, seed * 1000);
        for i in 0..30 {
            let picture = scene(Vector2::zeros(), noise, seed * 1000 + 500 + i);
            let changed = map.changed(&picture, &at_rest(), start_s + i as f64 * 0.1);
            prop_assert_eq!(changed.iter().collect::<Vec<_>>(), vec![]);
        }
    }

    #[test]
    fn a_vehicle_is_a_change_until_inspected(noise in 0.0_f64..6.0, strength in 18_i32..40, seed in 0_u64..1000) {
        let (mut map, start_s) = learned(noise, seed * 1000);
        let block = the_block(&map);
        let seen = |map: &mut ChangeMap, i: u64| {
            let picture = with_block(scene(Vector2::zeros(), noise, seed * 1000 + 500 + i), strength);
            map.changed(&picture, &at_rest(), start_s + i as f64 * 0.1)
        };
        for i in 0..3 {
            prop_assert_eq!(seen(&mut map, i), block.clone());
        }
        let changed = seen(&mut map, 3);
        map.mark_inspected(&changed, &block);
        for i in 4..10 {
            prop_assert_eq!(seen(&mut map, i).iter().count(), 0);
        }
        let gone = scene(Vector2::zeros(), noise, seed * 1000 + 600);
        prop_assert_eq!(map.changed(&gone, &at_rest(), start_s + 1.0), block, "it left");
    }

    #[test]
    fn motion_is_no_change(x in -9.0_f64..9.0, y in -9.0_f64..9.0, noise in 0.0_f64..4.0) {
        let mut map = ChangeMap::new(&scene(Vector2::zeros(), noise, 1));
        for i in 0..30_u64 {
            let shift = Vector2::new(x, y) * [0.0, 1.0, 0.3, -1.0][(i % 4) as usize];
            let view = view(shift);
            let changed = map.changed(&scene(shift, noise, 2 + i), &view, i as f64 * 0.1);
            // Interpolation changes the noise and the fine texture, so single cells may differ.
            prop_assert!(changed.share() < 0.02, "picture {}: {:?}", i, changed.iter().collect::<Vec<_>>());
        }
    }

    #[test]
    fn groups_hold_every_cell_once(seed in 0_u64..1000, share in 0_u32..60) {
        let mut cells = ChangeMap::new(&scene(Vector2::zeros(), 0.0, 1)).no_cells();
        let mut state = seed;
        for row in 0..cells.rows {
            for column in 0..cells.columns {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                if (state >> 33) % 100 < u64::from(share) {
                    cells.insert(column, row);
                }
            }
        }
        let groups = cells.groups();
        let side = cells.side_px as f64;
        for (column, row) in cells.iter() {
            let (x, y) = ((column as f64 + 0.5) * side, (row as f64 + 0.5) * side);
            let inside = |g: &&[f64; 4]| (g[0]..g[2]).contains(&x) && (g[1]..g[3]).contains(&y);
            prop_assert!(groups.iter().any(|g| inside(&g)));
        }
        prop_assert!(groups.len() <= cells.iter().count());
        prop_assert_eq!(groups.is_empty(), cells.share() < 1e-9);
        let mut left = cells.clone();
        groups.iter().for_each(|g| left.remove_box(g));
        prop_assert_eq!(left.iter().count(), 0);
    }

    #[test]
    fn a_box_can_be_inserted(x in -60.0_f64..400.0, y in -60.0_f64..250.0, w in 0.0_f64..90.0, h in 0.0_f64..90.0) {
        let mut cells = ChangeMap::new(&scene(Vector2::zeros(), 0.0, 1)).no_cells();
        let bbox = [x, y, x + w, y + h];
        let (columns, rows) = cells.touched(&bbox);
        let side = cells.side_px as f64;
        let is_inside = x + w >= 0.0 && y + h >= 0.0 && x < cells.columns as f64 * side && y < cells.rows as f64 * side;
        prop_assert_eq!(columns.len() * rows.len() > 0, is_inside);
        cells.insert_box(&bbox);
        prop_assert_eq!(cells.iter().count(), columns.len() * rows.len());
        prop_assert_eq!(cells.share_of(&bbox), if is_inside { 1.0 } else { 0.0 });
        prop_assert_eq!(cells.groups().len(), usize::from(is_inside));
        cells.remove_box(&bbox);
        prop_assert_eq!(cells.clone(), cells.emptied());
    }
}

#[test]
fn flicker_is_ignored_and_a_vehicle_there_is_still_a_change() {
    let noise = 2.0;
    let (mut map, start_s) = learned(noise, 7);
    let mut flagged = Vec::new();
    for i in 0..60 {
        // Leaves move in a gust for half of every second.
        let strength = if i % 10 < 5 { 7 } else { 0 };
        let picture = with_block(scene(Vector2::zeros(), noise, 100 + i), strength);
        let changed = map.changed(&picture, &at_rest(), start_s + i as f64 * 0.1);
        flagged.push(changed.iter().count());
        map.mark_inspected(&changed, &map.no_cells());
    }
    assert_eq!(flagged[0], 12, "it is inspected at first: {flagged:?}");
    // Without learning, all twelve cells would be flagged in every second picture.
    let late = flagged[20..].iter().sum::<usize>();
    assert!(5 * late < 40 * 12 / 2, "{flagged:?}");
    let vehicle = with_block(scene(Vector2::zeros(), noise, 300), 35);
    assert_eq!(map.changed(&vehicle, &at_rest(), start_s + 6.0), the_block(&map));
    // After two minutes without wind, a weak change is inspected again.
    map.changed(&scene(Vector2::zeros(), noise, 301), &at_rest(), start_s + 6.05);
    map.mark_inspected(&the_block(&map), &map.no_cells());
    for i in 0..1200 {
        map.changed(&scene(Vector2::zeros(), noise, 400 + i), &at_rest(), start_s + 6.1 + i as f64 * 0.1);
    }
    let again = with_block(scene(Vector2::zeros(), noise, 2000), 7);
    assert_eq!(map.changed(&again, &at_rest(), start_s + 130.0), the_block(&map));
}

#[test]
fn boxes_at_the_edges_touch_the_right_cells() {
    let cells = ChangeMap::new(&scene(Vector2::zeros(), 0.0, 1)).no_cells();
    assert_eq!((cells.columns, cells.rows, cells.side_px), (21, 12, 16));
    let touched = |bbox: [f64; 4]| cells.touched(&bbox);
    assert_eq!(touched([0.0, 0.0, 15.0, 15.0]), (0..1, 0..1));
    assert_eq!(touched([15.0, 15.0, 17.0, 17.0]), (0..2, 0..2));
    assert_eq!(touched([-100.0, 170.0, 1000.0, 1000.0]), (0..21, 10..12));
    assert!(touched([-50.0, 0.0, -10.0, 10.0]).0.is_empty(), "left of the picture");
    assert!(touched([400.0, 0.0, 420.0, 10.0]).0.is_empty(), "right of it");
    assert!(cells.is_at_border(1, 5) && cells.is_at_border(19, 5) && !cells.is_at_border(2, 5));
    assert!(cells.share_of(&[-50.0, 0.0, -10.0, 10.0]) < 1e-9 && cells.groups().is_empty());
    // Cells that touch at a corner form one group. An empty cell between two cells separates them.
    let mut cells = cells.emptied();
    for (column, row) in [(2, 2), (3, 3), (5, 3)] {
        cells.insert(column, row);
    }
    assert_eq!(cells.groups(), [[32.0, 32.0, 64.0, 64.0], [80.0, 48.0, 96.0, 64.0]]);
}

/// Draws a street of 320 × 160 px with a parked car. `car` is the left edge, px, of a second car of 48 × 32 px, if
/// there is one.
fn street(car: Option<u32>) -> RgbImage {
    RgbImage::from_fn(320, 160, |x, y| {
        let is_car = car.is_some_and(|at| (at..at + 48).contains(&x) && (64..96).contains(&y));
        let is_parked = (240..280).contains(&x) && (8..40).contains(&y);
        let ground = (100 + (x * 7 + y * 3) % 50) as u8;
        Rgb(if is_car || is_parked { [230, 20, 20] } else { [ground; 3] })
    })
}

#[test]
fn a_passing_car_does_not_enter_the_background() {
    let grid = ChangeMap::new(&SmallGrey::of(&street(None)).unwrap()).no_cells();
    let parked = [240.0, 8.0, 279.0, 39.0];
    let mut background = Background::new(&street(Some(0)), &View::at_rest(&street(None)), grid.clone());
    assert!(background.bare_s().iter().flatten().all(Option::is_none));
    assert_eq!(background.cell_px(), 8);
    let x_at = |i: u32| i * 4;
    for i in 0..68 {
        let x = x_at(i);
        let mut busy = grid.clone();
        busy.insert_box(&[f64::from(x), 64.0, f64::from(x + 47), 95.0]);
        busy.insert_box(&parked);
        background.take(&street(Some(x)), &View::at_rest(&street(None)), &busy, f64::from(i) * 0.1);
    }
    let truth = street(None);
    for (x, y, pixel) in background.picture().enumerate_pixels() {
        assert_eq!(pixel, truth.get_pixel(x, y), "at {x}, {y}");
    }
    let bare_s = background.bare_s();
    assert_eq!((bare_s.len(), bare_s[0].len()), (20, 40));
    assert!(
        bare_s[1..5].iter().all(|row| row[30..35].iter().all(Option::is_none)),
        "the position of the parked car"
    );
    // This cell is always empty and is blended every two seconds.
    assert!((bare_s[19][0].unwrap() - 6.0).abs() < 0.11, "{:?}", bare_s[19][0]);
    // The car has left the first columns when its left edge is past them.
    let left_s = 0.1 * f64::from((0..68).find(|i| x_at(*i) >= 8).unwrap());
    let first = bare_s[9][0].unwrap();
    assert!((first - left_s).rem_euclid(2.0) < 0.11 && first >= left_s, "{first} after {left_s}");
}

#[test]
fn changes_of_light_are_followed_and_pictures_of_another_size_are_left_out() {
    let grid = ChangeMap::new(&SmallGrey::of(&street(None)).unwrap()).no_cells();
    let view = View::at_rest(&street(None));
    let mut background = Background::new(&street(None), &view, grid.clone());
    let mut brighter = street(None);
    brighter.iter_mut().for_each(|v| *v = v.saturating_add(20));
    background.take(&street(None), &view, &grid, 0.0);
    (1..=20).for_each(|i| background.take(&brighter, &view, &grid, f64::from(i) * 2.0));
    let worst = background.picture().iter().zip(brighter.iter()).map(|(a, b)| a.abs_diff(*b)).max();
    assert!(worst.unwrap() <= 2, "{worst:?}");
    let before = background.picture().clone();
    background.take(&RgbImage::new(100, 100), &view, &grid, 100.0);
    assert_eq!(background.picture(), &before);
}

#[test]
fn a_moving_camera_has_a_background_too() {
    // The camera sways over the street, and a car drives through.
    let scene =
        |car: u32, x: u32, y: u32| image::imageops::crop_imm(&street(Some(car)), x, y, 280, 140).to_image();
    let size = ImageSize { width: 280, height: 140 };
    let middle = scene(400, 20, 10);
    let grid = ChangeMap::new(&SmallGrey::of(&middle).unwrap()).no_cells();
    let mut background = Background::new(&scene(20, 20, 10), &View::at_rest(&middle), grid.clone());
    for i in 0..70_u32 {
        let (x, y, car) =
            ([20, 30, 38, 30, 20, 10, 2, 10][i as usize % 8], [10, 4, 0, 14, 20][i as usize % 5], 20 + 4 * i);
        let shift = [20.0 - f64::from(x), 10.0 - f64::from(y)];
        let mapping = Homography::from_numbers([1.0, 0.0, shift[0], 0.0, 1.0, shift[1], 0.0, 0.0]).unwrap();
        let view = View::new(None, PictureMotion::new(mapping, Lens::STRAIGHT, size), size);
        let mut busy = grid.clone();
        busy.insert_box(&[f64::from(car) - 20.0, 54.0, f64::from(car) + 27.0, 85.0]);
        background.take(&scene(car, x, y), &view, &busy, f64::from(i) * 0.1);
    }
    for (x, y, pixel) in background.picture().enumerate_pixels() {
        assert_eq!(pixel, middle.get_pixel(x, y), "at {x}, {y}");
    }
}
