//! Parquet tables: columns of numbers, null where a sample is missing.

use parquet::errors::ParquetError;
use parquet::file::reader::{FileReader, SerializedFileReader};
use parquet::record::Field;

use super::{Columns, Place, Record};
use crate::model::Names;
use crate::scenario::Error;

pub(super) fn read(bytes: Vec<u8>, names: &Names, place: &Place) -> Result<Record, Error> {
    let broken = |row: usize, e: &ParquetError| {
        let remedy = "write it again, uncompressed or with snappy";
        place.error((row, 1), "", format!("not a table that can be read: {e}"), remedy)
    };
    let reader = match SerializedFileReader::new(bytes::Bytes::from(bytes)) {
        Ok(reader) => reader,
        Err(e) => return broken(1, &e),
    };
    let fields = reader.metadata().file_metadata().schema().get_fields();
    let header: Vec<String> = fields.iter().map(|f| f.name().to_string()).collect();
    let mut columns = Columns::new(header.clone(), names, place)?;
    let rows = match reader.get_row_iter(None) {
        Ok(rows) => rows,
        Err(e) => return broken(1, &e),
    };
    for (k, row) in rows.enumerate() {
        let row = match row {
            Ok(row) => row,
            Err(e) => return broken(k + 1, &e),
        };
        let values: Vec<&Field> = row.get_column_iter().map(|(_, field)| field).collect();
        let field = |column: usize| {
            let number = match values.get(column) {
                Some(field) => number(field),
                None => Some(f64::NAN),
            };
            match number {
                Some(v) if !v.is_infinite() => Ok(v),
                _ => {
                    let name = header.get(column).map_or("", String::as_str);
                    let remedy = "give a column of finite numbers, null where they are missing";
                    place.error((k + 1, column + 1), name, "not a finite number", remedy)
                }
            }
        };
        columns.row(k + 1, field)?;
    }
    Ok(columns.record)
}

/// The number in a field, NaN for null.
fn number(field: &Field) -> Option<f64> {
    Some(match *field {
        Field::Null => f64::NAN,
        Field::Double(v) => v,
        Field::Float(v) => f64::from(v),
        Field::Byte(v) => f64::from(v),
        Field::Short(v) => f64::from(v),
        Field::Int(v) => f64::from(v),
        Field::Long(v) => v as f64,
        Field::UByte(v) => f64::from(v),
        Field::UShort(v) => f64::from(v),
        Field::UInt(v) => f64::from(v),
        Field::ULong(v) => v as f64,
        _ => return None,
    })
}
