//! A tiny net (`tests/fixtures/make.py`), whole and spoilt in every way that a session must notice.

#![allow(clippy::unwrap_used, clippy::panic)] // the helpers below are test code, too
use std::path::{Path, PathBuf};

use ndarray::{ArrayD, IxDyn};
use roadplane_infer::{
    InferError, NamedTensor, Provider, ProviderChoice, Refusal, Session, SessionOptions, find_library,
};
use sha2::{Digest as _, Sha256};

const LOG: &[u8] = include_bytes!("fixtures/log.onnx");
const EXTERNAL: &[u8] = include_bytes!("fixtures/external.onnx");

fn card_text(model: &[u8]) -> String {
    let sha256: String = Sha256::digest(model).iter().map(|b| format!("{b:02x}")).collect();
    format!(
        r#"{{"schema": "roadplane.model-card/1", "name": "log", "version": 1, "file": "log.onnx",
            "sha256": "{sha256}", "licence": "MIT",
            "inputs": [{{"name": "x", "dtype": "f32", "shape": ["batch", 2]}}],
            "outputs": [{{"name": "y", "dtype": "f32", "shape": ["batch", 2]}}], "how_made": "make.py"}}"#
    )
}

/// A folder with a model and a card, which need not fit.
fn folder_with(model: &[u8], card: &str) -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("log.onnx"), model).unwrap();
    let card_path = folder.path().join("log.card.json");
    std::fs::write(&card_path, card).unwrap();
    (folder, card_path)
}

fn open(model: &[u8], card: &str) -> Result<Session, InferError> {
    let (_folder, card_path) = folder_with(model, card);
    let provider = ProviderChoice::Cpu;
    Session::open(&card_path, &SessionOptions { provider, ..SessionOptions::default() })
}

fn refusal(model: &[u8], card: &str) -> Refusal {
    match open(model, card) {
        Err(InferError::ModelRefused { reason, .. }) => reason,
        Err(other) => panic!("expected a refusal, got {other}"),
        Ok(_) => panic!("the model was accepted"),
    }
}

fn run(session: &mut Session, rows: usize, values: &[f32]) -> Result<ArrayD<f32>, InferError> {
    let x = ArrayD::from_shape_vec(IxDyn(&[rows, values.len() / rows]), values.to_vec()).unwrap();
    let outputs = session.run(&[NamedTensor { name: "x", values: x.view() }])?;
    Ok(outputs.take("y").unwrap())
}

#[test]
fn a_sound_net_runs_with_any_batch() {
    let mut session = open(LOG, &card_text(LOG)).unwrap();
    assert_eq!(session.provider(), Provider::Cpu);
    for rows in [1, 3] {
        let y = run(&mut session, rows, &vec![1.0; rows * 2]).unwrap();
        assert_eq!(y, ArrayD::from_elem(IxDyn(&[rows, 2]), 1.0));
    }
}

#[test]
fn numbers_that_are_not_finite_are_an_error_and_the_session_survives() {
    let mut session = open(LOG, &card_text(LOG)).unwrap();
    for (bad, expected) in [([-1.0, 1.0], 1), ([0.0, 0.0], 2), ([f32::NAN, 1.0], 1)] {
        let error = run(&mut session, 1, &bad).unwrap_err();
        assert!(matches!(error, InferError::NonFinite { count, .. } if count == expected), "{error}");
    }
    assert!(run(&mut session, 1, &[1.0, 2.0]).is_ok());
}

#[test]
fn wrong_tensors_are_a_bug_of_the_caller() {
    let mut session = open(LOG, &card_text(LOG)).unwrap();
    assert!(matches!(run(&mut session, 2, &[1.0; 6]), Err(InferError::WrongInput { .. })));
    assert!(matches!(session.run(&[]), Err(InferError::WrongInput { .. })));
    let x = ArrayD::zeros(IxDyn(&[0, 2]));
    let empty = session.run(&[NamedTensor { name: "x", values: x.view() }]);
    assert!(matches!(empty, Err(InferError::WrongInput { .. })));
}

#[test]
fn any_flipped_byte_is_refused_before_the_runtime_sees_it() {
    for at in 0..LOG.len() {
        let mut model = LOG.to_vec();
        model[at] ^= 0x10;
        assert!(matches!(refusal(&model, &card_text(LOG)), Refusal::WrongHash { .. }));
    }
}

#[test]
fn truncated_models_are_refused_even_with_a_hash_that_fits() {
    for length in 0..LOG.len() {
        let model = &LOG[..length];
        let reason = refusal(model, &card_text(model));
        assert!(
            matches!(reason, Refusal::NotOnnx(_) | Refusal::Rejected(_) | Refusal::Interface(_)),
            "cut at {length}: {reason}"
        );
    }
}

#[test]
fn data_outside_the_file_is_refused() {
    let reason = refusal(EXTERNAL, &card_text(EXTERNAL));
    assert!(matches!(reason, Refusal::ExternalData(name) if name == "one"));
}

#[test]
fn cards_that_do_not_fit_are_refused() {
    let good = card_text(LOG);
    for (from, to) in [
        (
            r#"{"name": "x", "dtype": "f32", "shape": ["batch", 2]}"#,
            r#"{"name": "x", "dtype": "f32", "shape": ["batch", 3]}"#,
        ),
        (
            r#"{"name": "x", "dtype": "f32", "shape": ["batch", 2]}"#,
            r#"{"name": "x", "dtype": "f32", "shape": ["batch", "n"]}"#,
        ),
        (r#"{"name": "x", "#, r#"{"name": "z", "#),
        (
            r#"{"name": "y", "dtype": "f32", "shape": ["batch", 2]}"#,
            r#"{"name": "y", "dtype": "f32", "shape": [2]}"#,
        ),
    ] {
        assert!(good.contains(from));
        assert!(matches!(refusal(LOG, &good.replace(from, to)), Refusal::Interface(_)), "{to}");
    }
    for (from, to) in [
        ("roadplane.model-card/1", "roadplane.model-card/9"),
        (r#""file": "log.onnx""#, r#""file": "../log.onnx""#),
        (r#""dtype": "f32""#, r#""dtype": "i64""#),
    ] {
        assert!(matches!(refusal(LOG, &good.replace(from, to)), Refusal::UnsuitableCard(_)), "{to}");
    }
    assert!(matches!(refusal(LOG, "{"), Refusal::MalformedCard(_)));
    assert!(matches!(refusal(LOG, &good.replace("log.onnx", "absent.onnx")), Refusal::Unreadable(_)));
}

#[test]
fn a_missing_library_is_an_error_that_says_what_to_do() {
    let (_folder, card_path) = folder_with(LOG, &card_text(LOG));
    let library = Some(PathBuf::from("nowhere/libonnxruntime.so"));
    let error =
        Session::open(&card_path, &SessionOptions { library, ..SessionOptions::default() }).unwrap_err();
    assert!(matches!(error, InferError::RuntimeMissing { .. }));
    assert!(error.to_string().contains("scripts/setup"), "{error}");
    assert!(find_library(Some(Path::new("."))).is_err());
}

#[test]
fn openvino_agrees_with_the_cpu_where_it_is_installed() {
    let (_folder, card_path) = folder_with(LOG, &card_text(LOG));
    let options = SessionOptions { provider: ProviderChoice::Openvino, ..SessionOptions::default() };
    match Session::open(&card_path, &options) {
        Err(InferError::ProviderUnavailable { what, .. }) => println!("skipped: {what}"),
        Err(other) => panic!("{other}"),
        Ok(mut session) => {
            assert_eq!(session.provider(), Provider::OpenvinoBf16);
            let y = run(&mut session, 1, &[2.0, 3.0]).unwrap();
            assert!(y.iter().zip([2.0_f32, 3.0]).all(|(y, x)| (y - x.ln() - 1.0).abs() < 0.02), "{y}");
        }
    }
}
