//! Cuts a picture, or a part of it, into tiles for the net.

use crate::resample::Part;

/// Whether a box (left, top, right, bottom) comes within `near` px of an inner border of the part. A border of the
/// whole picture is no inner border.
///
/// Such a box is probably cut. The whole vehicle is in another part or in a coarser pass.
pub(crate) fn cuts(part: Part, [left, top, right, bottom]: [f64; 4], picture: Part, near: f64) -> bool {
    let (x1, y1) = (part.x + part.width, part.y + part.height);
    (part.x > 0 && left < part.x as f64 + near)
        || (part.y > 0 && top < part.y as f64 + near)
        || (x1 < picture.width && right > x1 as f64 - near)
        || (y1 < picture.height && bottom > y1 as f64 - near)
}

/// Returns tiles of equal size that cover a part with at least the given overlap. Their sides are at most `longest`.
pub(crate) fn tiles(part: Part, longest: usize, overlap: usize) -> Vec<Part> {
    let mut all = Vec::new();
    let (columns, width) = spans(part.width, longest, overlap);
    let (rows, height) = spans(part.height, longest, overlap);
    for &y in &rows {
        for &x in &columns {
            all.push(Part { x: part.x + x, y: part.y + y, width, height });
        }
    }
    all
}

/// Returns the starts and the common length of the tiles along one axis.
fn spans(length: usize, longest: usize, overlap: usize) -> (Vec<usize>, usize) {
    if length <= longest {
        return (vec![0], length);
    }
    let count = (length - overlap).div_ceil(longest - overlap);
    let span = (length + (count - 1) * overlap).div_ceil(count);
    let last = length - span;
    ((0..count).map(|i| last * i / (count - 1)).collect(), span)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tiles_cover_and_overlap() {
        for length in [100, 416, 417, 800, 1920, 3840, 4096] {
            let (starts, span) = spans(length, 416, 96);
            assert!(span <= 416 && starts[0] == 0 && starts[starts.len() - 1] + span == length, "{length}");
            assert!(starts.windows(2).all(|pair| pair[0] + span >= pair[1] + 96 - 1), "{length}: {starts:?}");
        }
        let whole = |width, height| Part { x: 0, y: 0, width, height };
        assert_eq!(tiles(whole(1920, 1080), 1920, 192), [whole(1920, 1080)]);
        assert_eq!(tiles(whole(3840, 2160), 1920, 192).len(), 6);
    }

    #[test]
    fn boxes_at_inner_borders_are_cut() {
        let tile = Part { x: 100, y: 0, width: 100, height: 100 };
        let picture = |width| Part { x: 0, y: 0, width, height: 100 };
        assert!(cuts(tile, [101.0, 20.0, 140.0, 50.0], picture(200), 4.0));
        assert!(!cuts(tile, [120.0, 0.0, 199.5, 99.5], picture(200), 4.0), "the picture's own borders");
        assert!(cuts(tile, [120.0, 10.0, 199.5, 50.0], picture(300), 4.0));
    }
}
