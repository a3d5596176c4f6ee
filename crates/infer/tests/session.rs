//! Tests sessions with a tiny net from `tests/fixtures/make.py`: intact, and with each kind of damage that a session
//! must detect.

#![allow(clippy::unwrap_used, clippy::panic)] // the helpers below are test code, too
use std::path::{Path, PathBuf};

use ndarray::{ArrayD, IxDyn};
use roadplane_infer::{
    InferError, NamedTensor, Processor, Provider, ProviderChoice, Refusal, Session, SessionOptions,
    find_library,
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

/// Creates a folder with a model and a card. The two need not agree.
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
fn truncated_models_are_refused_even_with_a_matching_hash() {
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

/// Returns the card of the tiny net with an additional int8 file: its name is `file`, and its hash is that of
/// `hash_of`.
fn with_variant(file: &str, hash_of: &[u8], more: &str) -> String {
    let sha256: String = Sha256::digest(hash_of).iter().map(|b| format!("{b:02x}")).collect();
    let variant = format!(r#"{{"precision": "int8", "file": "{file}", "sha256": "{sha256}"{more}}}"#);
    card_text(LOG).replacen('{', &format!(r#"{{"variants": [{variant}], "#), 1)
}

fn open_as(provider: ProviderChoice, card: &str, int8: Option<&[u8]>) -> Result<Session, InferError> {
    let (folder, card_path) = folder_with(LOG, card);
    if let Some(model) = int8 {
        std::fs::write(folder.path().join("log.int8.onnx"), model).unwrap();
    }
    Session::open(&card_path, &SessionOptions { provider, ..SessionOptions::default() })
}

/// Returns the provider that `auto` chooses on this machine if a card has an int8 file.
fn automatic() -> Provider {
    let here = Processor::here();
    if here.int8 && !here.bf16_matrices { Provider::Int8 } else { Provider::Cpu }
}

#[test]
fn the_int8_file_is_chosen_where_it_is_fast_and_never_for_f32() {
    let calibration = r#", "calibration": {"a": 2}"#;
    // The same net with the name of another producer, so its hash differs.
    let int8 = [LOG, &[0x12, 1, b'q']].concat();
    let card = with_variant("log.int8.onnx", &int8, calibration);
    let mut session = open_as(ProviderChoice::Int8, &card, Some(&int8)).unwrap();
    assert_eq!(session.provider(), Provider::Int8);
    assert_eq!(session.provider().to_string(), "CPU int8");
    assert_eq!(session.card().file, "log.int8.onnx");
    assert_eq!(session.card().sha256, session.card().variants[0].sha256);
    assert_eq!(session.card().calibration["a"], 2);
    assert!(run(&mut session, 2, &[1.0; 4]).is_ok());
    let f32 = open_as(ProviderChoice::Cpu, &card, Some(&int8)).unwrap();
    assert_eq!((f32.provider(), f32.card().file.as_str()), (Provider::Cpu, "log.onnx"));
    assert!(f32.card().calibration.is_empty() && f32.card().sha256 != session.card().sha256);
    if !Processor::here().bf16_matrices {
        assert_eq!(open_as(ProviderChoice::Auto, &card, Some(&int8)).unwrap().provider(), automatic());
    }
}

#[test]
fn without_an_int8_file_auto_stays_with_f32_and_int8_is_an_error() {
    let absent = with_variant("log.int8.onnx", LOG, "");
    for card in [card_text(LOG), absent.clone()] {
        assert_ne!(open_as(ProviderChoice::Auto, &card, None).unwrap().provider(), Provider::Int8);
    }
    let error = open_as(ProviderChoice::Int8, &card_text(LOG), None).unwrap_err();
    assert!(matches!(error, InferError::ProviderUnavailable { provider: "int8", .. }), "{error}");
    let error = open_as(ProviderChoice::Int8, &absent, None).unwrap_err();
    assert!(matches!(error, InferError::ModelRefused { reason: Refusal::Unreadable(_), .. }), "{error}");
}

#[test]
fn an_int8_file_is_checked_like_any_other() {
    let refused = |choice, card: &str, int8: &[u8]| match open_as(choice, card, Some(int8)) {
        Err(InferError::ModelRefused { reason, path }) => (reason, path),
        Err(other) => panic!("expected a refusal, got {other}"),
        Ok(_) => panic!("the model was accepted"),
    };
    let spoilt = with_variant("log.int8.onnx", b"another", "");
    let (reason, path) = refused(ProviderChoice::Int8, &spoilt, LOG);
    assert!(matches!(reason, Refusal::WrongHash { .. }) && path.ends_with("log.int8.onnx"), "{reason}");
    if automatic() == Provider::Int8 {
        assert!(matches!(refused(ProviderChoice::Auto, &spoilt, LOG).0, Refusal::WrongHash { .. }));
    }
    let outside = with_variant("log.int8.onnx", EXTERNAL, "");
    assert!(matches!(refused(ProviderChoice::Int8, &outside, EXTERNAL).0, Refusal::ExternalData(_)));
    for card in [
        with_variant("../log.int8.onnx", LOG, ""),
        with_variant("log.int8.onnx", LOG, "").replacen(r#""sha256": ""#, r#""sha256": "0"#, 1),
    ] {
        assert!(matches!(refused(ProviderChoice::Cpu, &card, LOG).0, Refusal::UnsuitableCard(_)));
    }
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
