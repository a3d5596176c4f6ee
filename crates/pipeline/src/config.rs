//! Configuration: TOML file + `--set key=value` → [`Config`], checked once here. `configs/default.toml` documents
//! every field with unit and range and a test keeps it equal to the defaults.

use std::path::Path;

use serde::{Deserialize, Serialize};
use sha2::{Digest as _, Sha256};
use thiserror::Error;

/// What is wrong with a configuration.
#[derive(Debug, Error)]
pub enum ConfigError {
    /// The file cannot be read.
    #[error("cannot read the configuration: {source}: {path}")]
    Unreadable {
        /// Why.
        source: std::io::Error,
        /// The file.
        path: String,
    },
    /// Not TOML, an unknown key, or a value of a wrong type; the text shows line and column.
    #[error("in {origin}: {problem}")]
    Malformed {
        /// The file, or `--set …`.
        origin: String,
        /// What the parser says.
        problem: String,
    },
    /// A value out of its range.
    #[error("{key} = {value}: must be {range} (see configs/default.toml)")]
    OutOfRange {
        /// Dotted key.
        key: &'static str,
        /// The value given.
        value: String,
        /// What is allowed.
        range: String,
    },
}

impl Config {
    /// Reads a file (if any), applies `key=value` settings over it and checks every value.
    ///
    /// # Errors
    /// [`ConfigError`] naming file and line, or the setting, that is wrong.
    pub fn load(file: Option<&Path>, settings: &[String]) -> Result<Self, ConfigError> {
        let mut table = toml::Table::new();
        if let Some(path) = file {
            let text = std::fs::read_to_string(path)
                .map_err(|source| ConfigError::Unreadable { source, path: path.display().to_string() })?;
            // Read the file on its own first: only so can an error show its line.
            toml::from_str::<Self>(&text).map_err(|e| malformed(path.display().to_string(), &e))?;
            table = toml::from_str(&text).map_err(|e| malformed(path.display().to_string(), &e))?;
        }
        for setting in settings {
            apply_setting(&mut table, setting)?;
            // After each one, so that the error names the setting at fault.
            Self::deserialize(table.clone()).map_err(|e| malformed(format!("--set {setting}"), &e))?;
        }
        let config = Self::deserialize(table).map_err(|e| malformed("the configuration".to_owned(), &e))?;
        config.check()?;
        Ok(config)
    }

    /// sha256 (hex) of the resolved values: equal exactly when two runs were configured alike.
    #[must_use]
    pub fn fingerprint(&self) -> String {
        let bytes = serde_json::to_vec(self).unwrap_or_default();
        hex(&Sha256::digest(bytes))
    }
}

/// Lower-case hexadecimal.
#[must_use]
pub fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|b| format!("{b:02x}")).collect()
}

fn malformed(origin: String, error: &toml::de::Error) -> ConfigError {
    ConfigError::Malformed { origin, problem: error.to_string().trim_end().to_owned() }
}

fn apply_setting(table: &mut toml::Table, setting: &str) -> Result<(), ConfigError> {
    let fail = |problem: &str| ConfigError::Malformed {
        origin: format!("--set {setting}"),
        problem: problem.to_owned(),
    };
    let (key, text) = setting.split_once('=').ok_or_else(|| fail("write it as section.key=value"))?;
    // `value` is TOML; a bare word is taken as a string.
    let value = toml::from_str::<toml::Table>(&format!("v = {text}"))
        .ok()
        .and_then(|mut parsed| parsed.remove("v"))
        .unwrap_or_else(|| toml::Value::String(text.to_owned()));
    let mut parts: Vec<&str> = key.trim().split('.').collect();
    let last = parts.pop().filter(|last| !last.is_empty()).ok_or_else(|| fail("the key is empty"))?;
    let mut at = table;
    for part in parts {
        at = at
            .entry(part)
            .or_insert_with(|| toml::Value::Table(toml::Table::new()))
            .as_table_mut()
            .ok_or_else(|| fail(&format!("{part} is no section")))?;
    }
    at.insert(last.to_owned(), value);
    Ok(())
}
