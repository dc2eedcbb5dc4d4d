//! Errors of Texfold as exceptions, each with its causes in one message.

use std::error::Error;

use pyo3::PyErr;

mod exceptions {
    #![allow(missing_docs, reason = "types that the macro makes of those in texfold/_errors.py")]
    pyo3::import_exception!(texfold._errors, BankError);
    pyo3::import_exception!(texfold._errors, EncodeError);
    pyo3::import_exception!(texfold._errors, LoadError);
    pyo3::import_exception!(texfold._errors, RegionError);
}

/// A message with those of its causes.
fn message(error: &dyn Error) -> String {
    let mut message = error.to_string();
    let mut cause = error.source();
    while let Some(error) = cause {
        let text = error.to_string();
        // Transparent errors repeat their cause.
        if !message.ends_with(&text) {
            message = format!("{message}: {text}");
        }
        cause = error.source();
    }
    message
}

/// An `EncodeError`.
pub(crate) fn encode_error(error: &dyn Error) -> PyErr {
    exceptions::EncodeError::new_err(message(error))
}

/// A `LoadError`.
pub(crate) fn load_error(error: &dyn Error) -> PyErr {
    exceptions::LoadError::new_err(message(error))
}

/// A `BankError`.
pub(crate) fn write_error(error: &dyn Error) -> PyErr {
    exceptions::BankError::new_err(message(error))
}

/// A `RegionError`.
pub(crate) fn region_error(error: &dyn Error) -> PyErr {
    exceptions::RegionError::new_err(message(error))
}
