//! A small histogram as SVG.

/// Number of bars.
const BARS: usize = 24;
/// Width and height of the drawing, px.
const SIZE_PX: (f64, f64) = (480.0, 120.0);

/// Returns a histogram as SVG. `sorted` contains the values in ascending order. The last bar includes the values above
/// the 99 % quantile.
pub(crate) fn histogram(sorted: &[f64], unit: &str) -> String {
    let Some(top) = sorted.get((sorted.len().saturating_sub(1)) * 99 / 100).filter(|top| **top > 0.0) else {
        return String::new();
    };
    let mut counts = [0u32; BARS];
    for value in sorted {
        counts[((value / top * BARS as f64) as usize).min(BARS - 1)] += 1;
    }
    let most = f64::from(counts.iter().copied().max().unwrap_or(1).max(1));
    let (width, height) = SIZE_PX;
    let bar_width = width / BARS as f64;
    let bars: String = counts
        .iter()
        .enumerate()
        .map(|(i, count)| {
            let bar = f64::from(*count) / most * height;
            let (x, y) = (i as f64 * bar_width, height - bar);
            format!("<rect x=\"{x:.1}\" y=\"{y:.1}\" width=\"{:.1}\" height=\"{bar:.1}\"/>", bar_width - 2.0)
        })
        .collect();
    let below = height + 16.0;
    format!(
        "<svg viewBox=\"0 0 {width} {:.0}\" width=\"{width}\" role=\"img\" aria-label=\"histogram\" font-size=\"12\">\
         <g fill=\"#2a6fb0\">{bars}</g><path d=\"M0 {height}H{width}\" stroke=\"#66707a\"/>\
         <text y=\"{below}\" fill=\"#66707a\">0</text>\
         <text x=\"{width}\" y=\"{below}\" fill=\"#66707a\" text-anchor=\"end\">{top:.1} {unit}</text></svg>\n",
        height + 20.0
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_largest_bar_reaches_the_top_and_no_values_give_no_histogram() {
        let values: Vec<f64> = (0..200).map(|i| f64::from(i) / 100.0).collect();
        let svg = histogram(&values, "px");
        assert_eq!(svg.matches("<rect").count(), BARS);
        assert!(svg.contains("height=\"120.0\"") && svg.contains("2.0 px"), "{svg}");
        assert_eq!(histogram(&[], "px"), "");
        assert_eq!(histogram(&[0.0, 0.0], "px"), "");
    }
}
