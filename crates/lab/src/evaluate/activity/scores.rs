//! Accuracy, precision and recall of predicted labels. Precision and recall are averaged over labels.

use roadplane_activity::{LABELS, Label};
use roadplane_tables::bootstrap_scenes;
use roadplane_tables::{Cell, Column, Table};

/// A scored case, such as a car in a frame: the true labels, and the prediction of each system.
#[derive(Clone, Debug)]
pub struct Case {
    /// The right labels: one label, or several labels near a change of the true label.
    pub truth: Vec<Label>,
    /// The predicted label of each system.
    pub predicted: Vec<Label>,
}

/// A confusion matrix: the number of cases by true label (first index) and predicted label (second index).
type Confusion = [[f64; LABELS]; LABELS];

/// Returns accuracy, precision and recall, 0–1. Precision and recall are means over those `labels` that occur in the
/// truth.
fn measures(counts: &Confusion, labels: &[Label]) -> [f64; 3] {
    let total: f64 = counts.iter().flatten().sum();
    let hits: f64 = (0..LABELS).map(|i| counts[i][i]).sum();
    let mean = |each: Vec<f64>| each.iter().sum::<f64>() / each.len() as f64;
    let there: Vec<usize> =
        labels.iter().map(|label| label.index()).filter(|i| counts[*i].iter().sum::<f64>() > 0.0).collect();
    let of = |i: &usize| precision_recall(counts, *i);
    [
        hits / total,
        mean(there.iter().map(|i| of(i)[0]).collect()),
        mean(there.iter().map(|i| of(i)[1]).collect()),
    ]
}

/// Returns precision and recall (0–1) of the label with index `i`. The precision of a label that is never predicted is
/// 0.
fn precision_recall(counts: &Confusion, i: usize) -> [f64; 2] {
    let predicted: f64 = counts.iter().map(|row| row[i]).sum();
    let true_ones: f64 = counts[i].iter().sum();
    [counts[i][i] / predicted.max(1.0), counts[i][i] / true_ones]
}

fn confusion<'a>(cases: impl Iterator<Item = &'a Case>, system: usize) -> Confusion {
    let mut counts = [[0.0; LABELS]; LABELS];
    for case in cases {
        let predicted = case.predicted[system];
        let truth = if case.truth.contains(&predicted) { predicted } else { case.truth[0] };
        counts[truth.index()][predicted.index()] += 1.0;
    }
    counts
}

/// Returns the confusion matrices of the given systems (indices) for each clip.
fn confusions<const N: usize>(clips: &[Vec<Case>], systems: [usize; N]) -> Vec<[Confusion; N]> {
    clips.iter().map(|clip| systems.map(|system| confusion(clip.iter(), system))).collect()
}

/// Returns the sum of the clips' confusion matrices. `which` is the index of the matrix in each clip.
fn pooled<const N: usize>(clips: &[&[Confusion; N]], which: usize) -> Confusion {
    let sum = |truth: usize, label: usize| clips.iter().map(|clip| clip[which][truth][label]).sum();
    std::array::from_fn(|truth| std::array::from_fn(|label| sum(truth, label)))
}

fn columns() -> Vec<Column> {
    ["", "accuracy, %", "precision", "recall"]
        .iter()
        .enumerate()
        .map(|(i, name)| Column::new(*name, if i == 1 { 1 } else { 3 }))
        .collect()
}

/// Returns a table row of accuracy (%), precision and recall, with intervals from resampling clips.
fn row<const N: usize>(
    name: String,
    clips: &[Vec<Case>],
    systems: [usize; N],
    statistic: impl Fn(&[&[Confusion; N]]) -> [f64; 3],
) -> Vec<Cell> {
    let n = clips.iter().map(Vec::len).sum();
    let counts = confusions(clips, systems);
    let estimate = |which: usize| bootstrap_scenes(&counts, n, |chosen| statistic(chosen)[which]);
    vec![name.into(), estimate(0).scaled(100.0).into(), estimate(1).into(), estimate(2).into()]
}

/// Returns the table of accuracy, precision and recall, with one row per system and intervals from resampling clips.
pub fn table(title: &str, note: &str, clips: &[Vec<Case>], systems: &[&str], labels: &[Label]) -> Table {
    let mut table = Table::new(title, note, columns());
    for (system, name) in systems.iter().enumerate() {
        let of = |chosen: &[&[Confusion; 1]]| measures(&pooled(chosen, 0), labels);
        table.rows.push(row((*name).to_owned(), clips, [system], of));
    }
    table
}

/// Returns the table of the differences in accuracy, precision and recall between `system` and each other system.
pub fn differences(
    title: &str,
    clips: &[Vec<Case>],
    systems: &[&str],
    system: usize,
    labels: &[Label],
) -> Table {
    let mut table = Table::new(title, "Both systems are resampled on the same clips.", columns());
    for (other, name) in systems.iter().enumerate().filter(|(other, _)| *other != system) {
        let of = |chosen: &[&[Confusion; 2]]| {
            let [ours, theirs] = [0, 1].map(|which| measures(&pooled(chosen, which), labels));
            std::array::from_fn(|i| ours[i] - theirs[i])
        };
        table.rows.push(row(format!("{} − {name}", systems[system]), clips, [system, other], of));
    }
    table
}

/// Returns the table of precision and recall for one system, with one row per label.
pub fn each_label(title: &str, clips: &[Vec<Case>], system: usize) -> Table {
    let columns = vec![
        Column::new("", 0),
        Column::new("cases", 0),
        Column::new("precision", 3),
        Column::new("recall", 3),
        Column::new("taken for", 0),
    ];
    let mut table = Table::new(title, "", columns);
    let counts = confusion(clips.iter().flatten(), system);
    for label in Label::ALL {
        let i = label.index();
        let cases: f64 = counts[i].iter().sum();
        if cases == 0.0 {
            continue;
        }
        let [precision, recall] = precision_recall(&counts, i);
        let wrong = Label::ALL
            .into_iter()
            .filter(|other| *other != label && counts[i][other.index()] >= 0.03 * cases);
        let wrong: Vec<String> =
            wrong.map(|other| format!("{other} {:.0} %", 100.0 * counts[i][other.index()] / cases)).collect();
        let cells: [Cell; 5] =
            [label.name().into(), cases.into(), precision.into(), recall.into(), wrong.join(", ").into()];
        table.rows.push(cells.to_vec());
    }
    table
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn precision_and_recall_by_hand() {
        let case = |truth: &[Label], label| Case { truth: truth.to_vec(), predicted: vec![label] };
        let (go, stop, left) = (Label::Moving, Label::Stopping, Label::TurningLeft);
        let cases = [
            case(&[go], go),
            case(&[go], go),
            case(&[go], stop),
            case(&[stop], stop),
            // Near a change both labels are right.
            case(&[stop, go], go),
            case(&[left], go),
        ];
        let counts = confusion(cases.iter(), 0);
        let [accuracy, precision, recall] = measures(&counts, &[go, stop]);
        assert!((accuracy - 4.0 / 6.0).abs() < 1e-12);
        assert!((precision - (3.0 / 4.0 + 1.0 / 2.0) / 2.0).abs() < 1e-12);
        assert!((recall - (3.0 / 4.0 + 1.0) / 2.0).abs() < 1e-12);
        // A label that does not occur is left out of the means.
        assert_eq!(measures(&counts, &[go, stop, Label::UTurn]), [accuracy, precision, recall]);
    }
}
