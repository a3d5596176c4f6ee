//! Tests the output on a terminal, where progress bars are between the lines of the log.

use crate::common::{process, root};

/// Returns the lines of a terminal after this output.
fn screen(output: &str) -> Vec<String> {
    let (mut lines, mut row, mut column) = (vec![Vec::new()], 0_usize, 0_usize);
    let mut rest = output.chars();
    while let Some(c) = rest.next() {
        match c {
            '\r' => column = 0,
            '\n' => (row, column) = (row + 1, 0),
            '\x1b' => {
                rest.next();
                let mut code = String::new();
                let end = rest.by_ref().find(|c| {
                    code.push(*c);
                    c.is_ascii_alphabetic()
                });
                let count = code[..code.len() - 1].parse().unwrap_or(1);
                match end {
                    Some('A') => row = row.saturating_sub(count),
                    Some('B') => row += count,
                    Some('K') => lines[row].clear(),
                    _ => {}
                }
            }
            c => {
                let line: &mut Vec<char> = &mut lines[row];
                line.resize(line.len().max(column + 1), ' ');
                line[column] = c;
                column += 1;
            }
        }
        lines.resize(lines.len().max(row + 1), Vec::new());
    }
    lines.into_iter().map(|line| line.into_iter().collect()).collect()
}

#[test]
fn bars_vanish_and_show_no_unknown_totals() {
    let out = tempfile::tempdir().unwrap();
    let program = process();
    let run = |command: &str| {
        let command = format!("{} {command}", program.get_program().to_str().unwrap());
        let mut terminal = std::process::Command::new("script");
        terminal.args(["-qec", &command, "/dev/null"]).current_dir(root()).env("TERM", "xterm");
        let done =
            terminal.env("ORT_DYLIB_PATH", root().join(".runtime/libonnxruntime.so")).output().unwrap();
        assert!(done.status.success(), "{command}");
        String::from_utf8(done.stdout).unwrap()
    };
    let folder = out.path().display();
    let clip = "tests/data/lot.mp4 --set decode.max_frames=20";
    let seen = run(&format!("run {clip} --piece 0- --out {folder}/pieces"));
    assert!(seen.contains("/20 frames"), "no bar was shown: {seen}");
    let seen = [
        seen,
        run(&format!(
            "join {folder}/pieces/lot.piece-000000 --out {folder}/joined --set decode.max_frames=20"
        )),
    ];
    for seen in seen {
        assert!(!seen.contains("0/0 frames"), "{seen}");
        for rate in seen.split(" frames/s").map(|before| before.rsplit(' ').next().unwrap()) {
            assert!(rate.chars().filter(char::is_ascii_digit).count() <= 4, "{rate}");
        }
        let lines: Vec<String> = screen(&seen).into_iter().filter(|line| !line.trim().is_empty()).collect();
        assert!(lines.iter().any(|line| line.contains("INFO")), "{lines:?}");
        for line in &lines {
            assert!(line.starts_with("20"), "this line is not of the log: {line}");
        }
    }
}
