//! The study as a Parquet table, one row a plant and model and delay.

use std::io::Write;
use std::sync::Arc;

use parquet::basic::{Compression, LogicalType, Repetition, Type as Physical};
use parquet::column::writer::ColumnWriter;
use parquet::data_type::ByteArray;
use parquet::errors::{ParquetError, Result};
use parquet::file::metadata::KeyValue;
use parquet::file::properties::WriterProperties;
use parquet::file::writer::{SerializedFileWriter, SerializedRowGroupWriter};
use parquet::schema::types::{Type, TypePtr};

use crate::eip::EipSets;

/// Rows of a row group, at most: bounds the memory of writer and readers.
const GROUP_ROWS: usize = 1 << 16;

/// Writes the study as Parquet, without compression.
///
/// Columns: `delay`, one a grid parameter (`plant_` in front of a name that is
/// taken), `plant` and `model` (indices from 0), `label`, `upsilon` and `error`
/// (null where not defined), `winner` (true in the row of the winning model),
/// `margin` (of the plant; null without a winner or a runner-up). Row order:
/// delay, plant, model.
///
/// # Errors
/// Whatever `out` reports.
pub fn write(sets: &EipSets, out: impl Write + Send) -> Result<()> {
    let schema = Arc::new(schema(sets)?);
    let about = vec![
        KeyValue::new("mmae.schema".into(), super::json::SCHEMA.to_string()),
        KeyValue::new("mmae.version".into(), env!("CARGO_PKG_VERSION").to_string()),
        KeyValue::new("mmae.convention".into(), sets.convention.name().to_string()),
    ];
    let properties = WriterProperties::builder()
        .set_compression(Compression::UNCOMPRESSED)
        .set_created_by(concat!("mmae ", env!("CARGO_PKG_VERSION")).into())
        .set_key_value_metadata(Some(about))
        .build();
    let mut file = SerializedFileWriter::new(out, schema, Arc::new(properties))?;
    let n = sets.models.len().max(1);
    // whole plants, so that a group never splits one
    let step = (GROUP_ROWS / n).max(1);
    for case in 0..sets.cases.len() {
        let plants = sets.cases[case].winner.len();
        for from in (0..plants).step_by(step) {
            let rows = Rows { sets, case, from, to: (from + step).min(plants) };
            let mut group = file.next_row_group()?;
            rows.write(&mut group)?;
            group.close()?;
        }
    }
    file.close()?;
    Ok(())
}

const OWN: [&str; 8] = ["delay", "plant", "model", "label", "upsilon", "error", "winner", "margin"];

fn schema(sets: &EipSets) -> Result<Type> {
    let column = |name: &str, physical: Physical, optional: bool| -> Result<TypePtr> {
        let repetition = if optional { Repetition::OPTIONAL } else { Repetition::REQUIRED };
        let text = (physical == Physical::BYTE_ARRAY).then_some(LogicalType::String);
        let column = Type::primitive_type_builder(name, physical)
            .with_repetition(repetition)
            .with_logical_type(text);
        Ok(Arc::new(column.build()?))
    };
    let mut columns = vec![column("delay", Physical::DOUBLE, false)?];
    for (name, _) in sets.grid.axes() {
        let free = if OWN.contains(&name.as_str()) { &format!("plant_{name}") } else { name };
        columns.push(column(free, Physical::DOUBLE, false)?);
    }
    columns.push(column("plant", Physical::INT64, false)?);
    columns.push(column("model", Physical::INT32, false)?);
    columns.push(column("label", Physical::BYTE_ARRAY, false)?);
    columns.push(column("upsilon", Physical::DOUBLE, true)?);
    columns.push(column("error", Physical::DOUBLE, true)?);
    columns.push(column("winner", Physical::BOOLEAN, false)?);
    columns.push(column("margin", Physical::DOUBLE, true)?);
    Type::group_type_builder("eip").with_fields(columns).build()
}

/// The rows of some plants of one case.
struct Rows<'a> {
    sets: &'a EipSets,
    case: usize,
    from: usize,
    to: usize,
}

impl Rows<'_> {
    /// Writes the columns in the order of [`schema`].
    fn write<W: Write + Send>(&self, group: &mut SerializedRowGroupWriter<'_, W>) -> Result<()> {
        let case = &self.sets.cases[self.case];
        let n = self.sets.models.len();
        let labels: Vec<ByteArray> =
            self.sets.models.iter().map(|m| ByteArray::from(m.label.as_str())).collect();
        self.required(group, |_, _| case.delay)?;
        let points: Vec<Vec<f64>> =
            (self.from..self.to).map(|plant| self.sets.grid.point(plant)).collect();
        for axis in 0..self.sets.grid.axes().len() {
            self.required(group, |plant, _| points[plant - self.from][axis])?;
        }
        self.column(group, |writer, pairs| match writer {
            ColumnWriter::Int64ColumnWriter(w) => {
                let values: Vec<i64> = pairs.map(|(plant, _)| plant as i64).collect();
                w.write_batch(&values, None, None)
            }
            _ => Err(other_type()),
        })?;
        self.column(group, |writer, pairs| match writer {
            ColumnWriter::Int32ColumnWriter(w) => {
                let values: Vec<i32> = pairs.map(|(_, model)| model as i32).collect();
                w.write_batch(&values, None, None)
            }
            _ => Err(other_type()),
        })?;
        self.column(group, |writer, pairs| match writer {
            ColumnWriter::ByteArrayColumnWriter(w) => {
                let values: Vec<ByteArray> = pairs.map(|(_, i)| labels[i].clone()).collect();
                w.write_batch(&values, None, None)
            }
            _ => Err(other_type()),
        })?;
        self.optional(group, |plant, i| case.upsilon[plant * n + i])?;
        self.optional(group, |plant, i| {
            case.error.get(plant * n + i).copied().unwrap_or(f64::NAN)
        })?;
        self.column(group, |writer, pairs| match writer {
            ColumnWriter::BoolColumnWriter(w) => {
                let values: Vec<bool> =
                    pairs.map(|(plant, i)| case.winner[plant] == Some(i)).collect();
                w.write_batch(&values, None, None)
            }
            _ => Err(other_type()),
        })?;
        self.optional(group, |plant, _| case.margin[plant])
    }

    fn required<W: Write + Send>(
        &self,
        group: &mut SerializedRowGroupWriter<'_, W>,
        value: impl Fn(usize, usize) -> f64,
    ) -> Result<()> {
        self.column(group, |writer, pairs| match writer {
            ColumnWriter::DoubleColumnWriter(w) => {
                let values: Vec<f64> = pairs.map(|(plant, model)| value(plant, model)).collect();
                w.write_batch(&values, None, None)
            }
            _ => Err(other_type()),
        })
    }

    /// Null where the value is not finite.
    fn optional<W: Write + Send>(
        &self,
        group: &mut SerializedRowGroupWriter<'_, W>,
        value: impl Fn(usize, usize) -> f64,
    ) -> Result<()> {
        self.column(group, |writer, pairs| match writer {
            ColumnWriter::DoubleColumnWriter(w) => {
                let all: Vec<f64> = pairs.map(|(plant, model)| value(plant, model)).collect();
                let levels: Vec<i16> = all.iter().map(|v| i16::from(v.is_finite())).collect();
                let values: Vec<f64> = all.into_iter().filter(|v| v.is_finite()).collect();
                w.write_batch(&values, Some(&levels), None)
            }
            _ => Err(other_type()),
        })
    }

    fn column<W: Write + Send>(
        &self,
        group: &mut SerializedRowGroupWriter<'_, W>,
        fill: impl FnOnce(
            &mut ColumnWriter<'_>,
            &mut dyn Iterator<Item = (usize, usize)>,
        ) -> Result<usize>,
    ) -> Result<()> {
        let mut column = group.next_column()?.ok_or_else(other_type)?;
        let n = self.sets.models.len();
        let mut pairs = (self.from..self.to).flat_map(|plant| (0..n).map(move |i| (plant, i)));
        fill(column.untyped(), &mut pairs)?;
        column.close()
    }
}

/// The columns above do not match [`schema`]; a test keeps them in step.
fn other_type() -> ParquetError {
    ParquetError::General("the columns do not match the schema".into())
}
