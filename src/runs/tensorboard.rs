//! TensorBoard's event files: the numbers of a [`Record`] as scalars.
//!
//! A file is a row of records: the length of the data and its checksum, the data and its checksum (TFRecord). The data are
//! protocol buffers, of which only what scalars need is written down here.

use crc::{CRC_32_ISCSI, Crc};
use prost::Message;

use super::metrics::{Record, RecordKind};

const CHECKSUM: Crc<u32> = Crc::<u32>::new(&CRC_32_ISCSI);
/// Added to a turned checksum, so that checksums of checksums are no special case.
const MASK: u32 = 0xa282_ead8;
/// What a file begins with.
const VERSION: &str = "brain.Event:2";

/// `tensorflow.Event`, of which it has either a version or a summary.
#[derive(Clone, PartialEq, Message)]
struct EventMessage {
    /// Seconds since 1970.
    #[prost(double, tag = "1")]
    wall_time: f64,
    #[prost(int64, tag = "2")]
    step: i64,
    #[prost(string, optional, tag = "3")]
    file_version: Option<String>,
    #[prost(message, optional, tag = "5")]
    summary: Option<SummaryMessage>,
}

/// `tensorflow.Summary`.
#[derive(Clone, PartialEq, Message)]
struct SummaryMessage {
    #[prost(message, repeated, tag = "1")]
    value: Vec<ValueMessage>,
}

/// `tensorflow.Summary.Value`.
#[derive(Clone, PartialEq, Message)]
struct ValueMessage {
    #[prost(string, tag = "1")]
    tag: String,
    #[prost(float, optional, tag = "2")]
    simple_value: Option<f32>,
}

/// What a file begins with; `wall_time` is in seconds since 1970.
pub(crate) fn beginning(wall_time: f64) -> Vec<u8> {
    framed(&EventMessage { wall_time, file_version: Some(VERSION.into()), ..EventMessage::default() })
}

/// The numbers of a record that was made at `wall_time`; nothing where it has none.
pub(crate) fn scalars(record: &Record, wall_time: f64) -> Vec<u8> {
    let group = match record.kind {
        RecordKind::Train => "train",
        RecordKind::Valid => "valid",
        RecordKind::Identify => "identify",
        RecordKind::Begin | RecordKind::Other => return Vec::new(),
    };
    let losses = ["train_loss", "score", "recons_loss", "pred_loss", "extrap_loss", "residual", "velocity_residual"];
    let losses = losses.into_iter().filter_map(|name| Some((format!("{group}/{name}"), record.value(name)?)));
    let parameters = record.parameters.iter().map(|(name, value)| (format!("parameters/{name}"), *value));
    let value = |(tag, value): (String, f64)| ValueMessage { tag, simple_value: Some(value as f32) };
    let value: Vec<_> = losses.chain(parameters).map(value).collect();
    if value.is_empty() {
        return Vec::new();
    }
    framed(&EventMessage {
        wall_time,
        step: record.step as i64,
        summary: Some(SummaryMessage { value }),
        file_version: None,
    })
}

fn framed(event: &EventMessage) -> Vec<u8> {
    let data = event.encode_to_vec();
    let length = (data.len() as u64).to_le_bytes();
    [&length[..], &checksum(&length), &data, &checksum(&data)].concat()
}

fn checksum(bytes: &[u8]) -> [u8; 4] {
    CHECKSUM.checksum(bytes).rotate_right(15).wrapping_add(MASK).to_le_bytes()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// As TensorBoard's own Python writer writes a version at 1000 s, and two scalars of step 300 at 1002.5 s.
    const WRITTEN: &str = "1800000000000000a37f4b22090000000000408f401a0d627261696e2e4576656e743a3273ae6b56\
                           36000000000000004f578cef090000000000548f4010ac022a280a110a0a747261696e2f6c6f7373\
                           150000803e0a130a0c706172616d65746572732f6b150000804097384077";

    #[test]
    fn bytes_are_those_of_tensorboard() {
        let value = |tag: &str, value| ValueMessage { tag: tag.into(), simple_value: Some(value) };
        let summary = SummaryMessage { value: vec![value("train/loss", 0.25), value("parameters/k", 4.0)] };
        let event = EventMessage { wall_time: 1002.5, step: 300, summary: Some(summary), file_version: None };
        let bytes = [beginning(1000.0), framed(&event)].concat();
        let text: String = bytes.iter().map(|byte| format!("{byte:02x}")).collect();
        assert_eq!(text, WRITTEN);
    }

    #[test]
    fn a_record_gives_its_losses_and_parameters() {
        let mut record = Record { train_loss: Some(0.5), ..Record::new(RecordKind::Train, "join", 7) };
        record.parameters.insert("k".into(), 4.0);
        let bytes = scalars(&record, 1.0);
        let event = EventMessage::decode(&bytes[12..bytes.len() - 4]).unwrap();
        let tags: Vec<_> = event.summary.unwrap().value.into_iter().map(|value| value.tag).collect();
        assert_eq!((tags, event.step), (vec!["train/train_loss".to_string(), "parameters/k".into()], 7));
        assert!(scalars(&Record::begin(), 1.0).is_empty());
    }
}
