//! Reads the packets of a container without decoding them. It counts all packets, and the packets with broken headers.
//!
//! FFmpeg decodes around broken H.264 slices and only prints a message. The headers of these slices show the damage.

use opencv::core::Mat;
use opencv::prelude::*;
use opencv::videoio::{CAP_FFMPEG, CAP_PROP_FORMAT, CAP_PROP_FOURCC, VideoCapture};

/// Number of consecutive failed reads after which the end of the container is assumed.
const MAX_FAILED_READS: u32 = 1000;

/// The number of packets in a container, and the number of broken packets.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Packets {
    /// Number of packets of the video stream.
    pub count: u64,
    /// Number of packets with an H.264 unit that no encoder writes.
    pub broken: u64,
}

impl Packets {
    /// Reads the whole file and counts its packets. Returns `None` if OpenCV does not return packets for this file.
    pub(crate) fn read(path: &str) -> Option<Self> {
        let mut capture = VideoCapture::from_file(path, CAP_FFMPEG).ok()?;
        if !capture.is_opened().ok()? || !capture.set(CAP_PROP_FORMAT, -1.0).ok()? {
            return None;
        }
        let is_h264 = is_h264(capture.get(CAP_PROP_FOURCC).ok()?);
        let mut packets = Self::default();
        let mut bytes = Mat::default();
        let mut failed = 0;
        while failed < MAX_FAILED_READS {
            if !capture.grab().ok()? {
                failed += 1;
                continue;
            }
            failed = 0;
            packets.count += 1;
            if is_h264 && capture.retrieve_def(&mut bytes).ok()? {
                packets.broken += u64::from(is_broken_h264(bytes.data_bytes().ok()?));
            }
        }
        Some(packets)
    }
}

fn is_h264(fourcc: f64) -> bool {
    // The last entry is the stream type of H.264 in MPEG transport streams.
    const NAMES: [[u8; 4]; 6] = [*b"avc1", *b"avc3", *b"h264", *b"H264", *b"X264", [0x1b, 0, 0, 0]];
    NAMES.contains(&(fourcc as u32).to_le_bytes())
}

/// Whether an access unit (with start codes) contains a NAL unit that no encoder writes. Such a NAL unit has the
/// forbidden bit, no type, or a slice header that contradicts itself (ITU-T H.264 §7.3.1, §7.4.3).
fn is_broken_h264(packet: &[u8]) -> bool {
    let starts: Vec<usize> =
        packet.windows(3).enumerate().filter(|(_, w)| *w == [0, 0, 1]).map(|(at, _)| at + 3).collect();
    starts.iter().enumerate().any(|(k, &start)| {
        let end = starts.get(k + 1).map_or(packet.len(), |next| next - 3);
        is_broken_unit(packet.get(start..end).unwrap_or_default())
    })
}

fn is_broken_unit(unit: &[u8]) -> bool {
    let Some((&header, body)) = unit.split_first() else { return true };
    let kind = header & 0x1f;
    if header & 0x80 != 0 || kind == 0 {
        return true;
    }
    if kind != 1 && kind != 5 {
        return false;
    }
    let mut bits = Bits { bytes: body, at: 0 };
    let (Some(_first_macroblock), Some(slice_type), Some(parameter_set)) =
        (bits.exp_golomb(), bits.exp_golomb(), bits.exp_golomb())
    else {
        return true;
    };
    // An IDR picture has only I and SI slices.
    slice_type > 9 || parameter_set > 255 || (kind == 5 && !matches!(slice_type % 5, 2 | 4))
}

struct Bits<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl Bits<'_> {
    fn bit(&mut self) -> Option<u32> {
        let byte = self.bytes.get(self.at / 8)?;
        let bit = byte >> (7 - self.at % 8) & 1;
        self.at += 1;
        Some(u32::from(bit))
    }

    /// Reads an unsigned Exp-Golomb number. Returns `None` at the end of the bytes, or if the number has more than 31
    /// bits.
    fn exp_golomb(&mut self) -> Option<u32> {
        let mut zeros = 0;
        while self.bit()? == 0 {
            zeros += 1;
            if zeros > 30 {
                return None;
            }
        }
        (0..zeros).try_fold(1, |value, _| Some(value << 1 | self.bit()?)).map(|value: u32| value - 1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exp_golomb_numbers() {
        let mut bits = Bits { bytes: &[0b1010_0110, 0b0100_0000], at: 0 };
        assert_eq!(
            [bits.exp_golomb(), bits.exp_golomb(), bits.exp_golomb(), bits.exp_golomb()].map(Option::unwrap),
            [0, 1, 2, 3]
        );
        assert_eq!(Bits { bytes: &[0; 8], at: 0 }.exp_golomb(), None);
    }

    #[test]
    fn slices_that_cannot_be_are_broken() {
        // The first slice has first_mb 0, slice_type 7 (I), pps 0. The second slice has slice_type 0 (P), which is not
        // allowed in an IDR picture.
        let (intra, inter) = ([0x65, 0b1000_1000, 0b1000_0000], [0x65, 0b1110_0000]);
        let join =
            |units: &[&[u8]]| units.iter().flat_map(|u| [&[0, 0, 1], *u].concat()).collect::<Vec<u8>>();
        let sets: [&[u8]; 2] = [&[0x67, 0x64], &[0x68, 0xeb]];
        assert!(!is_broken_h264(&join(&[sets[0], sets[1], &intra])));
        assert!(is_broken_h264(&join(&[sets[0], sets[1], &inter, &intra])));
        assert!(!is_broken_h264(&join(&[&[0x41, 0b1110_0000]])), "a P slice outside an IDR picture");
        assert!(is_broken_h264(&join(&[&[0xe5, 0b1000_1000, 0x80]])), "forbidden bit");
        assert!(is_broken_h264(&join(&[&[0, 0, 0, 0, 0]])), "zeros");
        assert!(is_broken_h264(&join(&[&[0x65]])), "no header");
    }
}
