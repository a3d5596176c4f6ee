//! Bar charts as SVG.

use std::fmt::Write as _;

/// Width and height of the bars' area, px.
const SIZE_PX: [f64; 2] = [720.0, 130.0];
/// Space on the left for the numbers, and below for the labels, px.
const MARGIN_PX: [f64; 2] = [44.0, 22.0];
/// Largest number of labels below a chart.
const MOST_LABELS: usize = 8;

/// A bar: its label, its value, and the ends of its interval. A bar without a value is a gap in the data.
pub(super) struct Bar {
    pub(super) label: String,
    pub(super) value: Option<f64>,
    pub(super) interval: Option<[f64; 2]>,
}

/// Returns a bar chart. `name` describes it for a reader who does not see it.
pub(super) fn bars(name: &str, bars: &[Bar]) -> String {
    let top = |bar: &Bar| bar.interval.map_or(0.0, |[_, high]| high).max(bar.value.unwrap_or(0.0));
    let most = bars.iter().map(top).fold(0.0, f64::max);
    if most <= 0.0 {
        return String::new();
    }
    let ([width, height], [left, below]) = (SIZE_PX, MARGIN_PX);
    let step = width / bars.len() as f64;
    let y = |value: f64| height - value / most * (height - 10.0);
    let mut svg = format!(
        "<svg viewBox=\"0 0 {:.0} {:.0}\" width=\"{:.0}\" role=\"img\" aria-label=\"{name}\" font-size=\"11\" \
         fill=\"var(--soft)\"><text x=\"{:.0}\" y=\"14\" text-anchor=\"end\">{}</text>\
         <text x=\"{:.0}\" y=\"{height}\" text-anchor=\"end\">0</text>",
        left + width + 4.0,
        height + below,
        left + width + 4.0,
        left - 6.0,
        number(most),
        left - 6.0,
    );
    let every = bars.len().div_ceil(MOST_LABELS);
    for (i, bar) in bars.iter().enumerate() {
        let x = left + step * i as f64;
        let mut put = |text: std::fmt::Arguments<'_>| {
            let _infallible = svg.write_fmt(text);
        };
        match bar.value {
            Some(value) => put(format_args!(
                "<rect x=\"{:.1}\" y=\"{:.1}\" width=\"{:.1}\" height=\"{:.1}\" fill=\"var(--accent)\"><title>{}: {}</title></rect>",
                x + step * 0.08,
                y(value),
                step * 0.84,
                height - y(value),
                bar.label,
                number(value)
            )),
            None => put(format_args!(
                "<rect x=\"{x:.1}\" y=\"10\" width=\"{step:.1}\" height=\"{:.1}\" fill=\"var(--line)\"><title>{}: no data</title></rect>",
                height - 10.0,
                bar.label
            )),
        }
        if let Some([low, high]) = bar.interval {
            let middle = x + step / 2.0;
            put(format_args!(
                "<path d=\"M{middle:.1} {:.1}V{:.1}\" stroke=\"var(--ink)\" stroke-width=\"1.2\"/>",
                y(low),
                y(high)
            ));
        }
        if i % every == 0 {
            put(format_args!("<text x=\"{x:.1}\" y=\"{:.0}\">{}</text>", height + 15.0, bar.label));
        }
    }
    let _infallible =
        writeln!(svg, "<path d=\"M{left} {height}h{width}\" stroke=\"var(--soft)\" fill=\"none\"/></svg>");
    svg
}

fn number(value: f64) -> String {
    if value.fract() == 0.0 { format!("{value:.0}") } else { format!("{value:.1}") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_value_is_a_bar_and_a_gap_is_grey() {
        let bar = |value, interval| Bar { label: "09:00".to_owned(), value, interval };
        let svg = bars("counts", &[bar(Some(4.0), Some([4.0, 5.0])), bar(None, None), bar(Some(2.5), None)]);
        assert_eq!((svg.matches("--accent").count(), svg.matches("no data").count()), (2, 1));
        assert!(svg.contains(">5</text>") && svg.contains("09:00: 2.5"), "{svg}");
        assert_eq!(bars("counts", &[bar(Some(0.0), None)]), "");
    }
}
