//! Detects processor instructions that make nets faster.

use std::sync::OnceLock;

/// The processor instructions that determine which execution provider is the fastest.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Processor {
    /// Whether the processor has VNNI instructions, which sum products of bytes without intermediate saturation.
    ///
    /// With VNNI, int8 nets are fast. Their outputs are then the same as in the measurements of their accuracy.
    pub int8: bool,
    /// Whether the processor has AMX instructions, which multiply matrices in bf16. With AMX, OpenVINO in bf16 is
    /// faster than int8.
    pub bf16_matrices: bool,
}

impl Processor {
    /// Returns the instructions that this machine's processor has.
    #[must_use]
    pub fn here() -> Self {
        static HERE: OnceLock<Processor> = OnceLock::new();
        *HERE.get_or_init(|| {
            std::fs::read_to_string("/proc/cpuinfo").map(|text| Self::of(&text)).unwrap_or_default()
        })
    }

    /// Reads the instructions from the text of `/proc/cpuinfo`.
    fn of(cpuinfo: &str) -> Self {
        let flags = cpuinfo.lines().find(|line| line.starts_with("flags")).unwrap_or_default();
        let has = |names: &[&str]| flags.split_whitespace().any(|flag| names.contains(&flag));
        Self { int8: has(&["avx512_vnni", "avx_vnni", "amx_int8"]), bf16_matrices: has(&["amx_bf16"]) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn flags_are_read_as_whole_words() {
        let of = |flags: &str| Processor::of(&format!("processor\t: 0\nflags\t\t: fpu {flags} sse\n"));
        assert_eq!(of("avx512f avx512_bf16"), Processor::default());
        assert_eq!(of("avx512_vnni"), Processor { int8: true, bf16_matrices: false });
        assert_eq!(of("avx_vnni_int16"), Processor::default());
        assert_eq!(of("amx_bf16 amx_int8"), Processor { int8: true, bf16_matrices: true });
        assert_eq!(Processor::of(""), Processor::default());
    }
}
