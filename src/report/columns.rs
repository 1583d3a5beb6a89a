//! Parquet tables, one group of rows after the other.

use std::io::Write;
use std::sync::Arc;

use parquet::basic::{Compression, LogicalType, Repetition, Type as Physical};
use parquet::column::writer::ColumnWriter;
use parquet::data_type::ByteArray;
use parquet::errors::{ParquetError, Result};
use parquet::file::metadata::KeyValue;
use parquet::file::properties::WriterProperties;
use parquet::file::writer::SerializedFileWriter;
use parquet::schema::types::{Type, TypePtr};

/// Values of a column, of one group of rows.
pub(crate) enum Column {
    Real(Vec<f64>),
    /// Null where the value is not finite.
    Number(Vec<f64>),
    Long(Vec<i64>),
    Int(Vec<i32>),
    Index(Vec<Option<i32>>),
    Text(Vec<ByteArray>),
    Note(Vec<Option<ByteArray>>),
    Flag(Vec<bool>),
}

/// Type of a column.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    Real,
    Number,
    Long,
    Int,
    Index,
    Text,
    Note,
    Flag,
}

impl Kind {
    fn physical(self) -> Physical {
        match self {
            Kind::Real | Kind::Number => Physical::DOUBLE,
            Kind::Long => Physical::INT64,
            Kind::Int | Kind::Index => Physical::INT32,
            Kind::Text | Kind::Note => Physical::BYTE_ARRAY,
            Kind::Flag => Physical::BOOLEAN,
        }
    }

    fn repetition(self) -> Repetition {
        match self {
            Kind::Number | Kind::Index | Kind::Note => Repetition::OPTIONAL,
            _ => Repetition::REQUIRED,
        }
    }
}

/// A table that is being written, without compression.
pub(crate) struct Table<W: Write + Send> {
    file: SerializedFileWriter<W>,
}

impl<W: Write + Send> Table<W> {
    /// A table with these columns; `about` is stored beside it, by name.
    pub(crate) fn new(
        out: W,
        name: &str,
        columns: &[(String, Kind)],
        about: &[(&str, &str)],
    ) -> Result<Self> {
        let field = |(name, kind): &(String, Kind)| -> Result<TypePtr> {
            let physical = kind.physical();
            let text = (physical == Physical::BYTE_ARRAY).then_some(LogicalType::String);
            let column = Type::primitive_type_builder(name, physical)
                .with_repetition(kind.repetition())
                .with_logical_type(text);
            Ok(Arc::new(column.build()?))
        };
        let fields: Result<Vec<TypePtr>> = columns.iter().map(field).collect();
        let schema = Type::group_type_builder(name).with_fields(fields?).build()?;
        let about =
            about.iter().map(|(key, value)| KeyValue::new((*key).into(), (*value).to_string()));
        let properties = WriterProperties::builder()
            .set_compression(Compression::UNCOMPRESSED)
            .set_created_by(concat!("mmae ", env!("CARGO_PKG_VERSION")).into())
            .set_key_value_metadata(Some(about.collect()))
            .build();
        let file = SerializedFileWriter::new(out, Arc::new(schema), Arc::new(properties))?;
        Ok(Self { file })
    }

    /// Writes a group of rows: a column each, in the order of [`Table::new`].
    pub(crate) fn group(&mut self, columns: impl IntoIterator<Item = Column>) -> Result<()> {
        let mut group = self.file.next_row_group()?;
        for values in columns {
            let mut column = group.next_column()?.ok_or_else(other_type)?;
            put(column.untyped(), values)?;
            column.close()?;
        }
        group.close()?;
        Ok(())
    }

    /// Writes the end of the file.
    pub(crate) fn close(self) -> Result<()> {
        self.file.close()?;
        Ok(())
    }
}

fn put(writer: &mut ColumnWriter<'_>, values: Column) -> Result<usize> {
    use ColumnWriter as W;
    match (writer, values) {
        (W::DoubleColumnWriter(w), Column::Real(v)) => w.write_batch(&v, None, None),
        (W::DoubleColumnWriter(w), Column::Number(v)) => {
            let levels: Vec<i16> = v.iter().map(|v| i16::from(v.is_finite())).collect();
            let values: Vec<f64> = v.into_iter().filter(|v| v.is_finite()).collect();
            w.write_batch(&values, Some(&levels), None)
        }
        (W::Int64ColumnWriter(w), Column::Long(v)) => w.write_batch(&v, None, None),
        (W::Int32ColumnWriter(w), Column::Int(v)) => w.write_batch(&v, None, None),
        (W::Int32ColumnWriter(w), Column::Index(v)) => {
            let (levels, values) = some(v);
            w.write_batch(&values, Some(&levels), None)
        }
        (W::ByteArrayColumnWriter(w), Column::Text(v)) => w.write_batch(&v, None, None),
        (W::ByteArrayColumnWriter(w), Column::Note(v)) => {
            let (levels, values) = some(v);
            w.write_batch(&values, Some(&levels), None)
        }
        (W::BoolColumnWriter(w), Column::Flag(v)) => w.write_batch(&v, None, None),
        _ => Err(other_type()),
    }
}

/// Levels of definition, and the values that there are.
fn some<T>(values: Vec<Option<T>>) -> (Vec<i16>, Vec<T>) {
    let levels = values.iter().map(|v| i16::from(v.is_some())).collect();
    (levels, values.into_iter().flatten().collect())
}

/// Columns that do not match the schema; tests keep them in step.
fn other_type() -> ParquetError {
    ParquetError::General("the columns do not match the schema".into())
}
