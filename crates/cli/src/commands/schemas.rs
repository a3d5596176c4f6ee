//! `roadplane schemas`: the JSON schemas of the files in a result.

use std::io::{Write as _, stdout};

use roadplane_pipeline::{PipelineError, schemas as all_schemas};
use roadplane_write::write_json;

use crate::args::SchemasArgs;
use roadplane_terminal::Outcome;

/// Prints the schemas, or writes them into a folder.
pub fn schemas(args: &SchemasArgs) -> anyhow::Result<Outcome> {
    let wanted = |name: &str| args.name.as_deref().is_none_or(|only| only == name);
    let found: Vec<_> = all_schemas().into_iter().filter(|(name, _)| wanted(name)).collect();
    if found.is_empty() {
        let names: Vec<_> = all_schemas().iter().map(|(name, _)| *name).collect();
        let what = format!("there is no such schema; choose one of {}", names.join(", "));
        return Err(PipelineError::usage(&what).into());
    }
    if let Some(folder) = &args.out {
        std::fs::create_dir_all(folder)
            .map_err(|source| PipelineError::Unreadable { source, path: folder.clone() })?;
        for (name, schema) in found {
            write_json(&folder.join(format!("{name}.schema.json")), &schema).map_err(PipelineError::from)?;
        }
        return Ok(Outcome::Done);
    }
    let mut out = stdout().lock();
    for (_, schema) in found {
        writeln!(out, "{schema:#}")?;
    }
    Ok(Outcome::Done)
}
