//! Outcomes of functions, and the text of the last failure.

use std::cell::RefCell;
use std::error::Error;
use std::ffi::{CStr, CString, c_char};
use std::panic::{AssertUnwindSafe, catch_unwind};

use texfold::BytesError;
use texfold::core::{EncodeError, LoadError, NameError, RegionError};
use texfold_shaders::DctProgramError;

/// Outcome of a function.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Status {
    /// The result is there.
    Ok = 0,
    /// A null pointer, a wrong length, an unknown name or a number out of range.
    Argument = 1,
    /// Not a file of textures of images, or damaged.
    File = 2,
    /// More texels or bytes than the limits allow.
    Limit = 3,
    /// There is no such image or level, or the region leaves it.
    Region = 4,
    /// The images cannot be encoded so.
    Encode = 5,
    /// Cancelled by the caller.
    Cancelled = 6,
    /// A fault of the library; its state stays usable. Please report it.
    Fault = 7,
}

/// Why a function failed.
#[derive(Debug)]
pub(crate) struct Failure {
    status: Status,
    text: String,
}

/// A result of a function.
pub(crate) type Outcome<T> = Result<T, Failure>;

impl Failure {
    /// A wrong argument.
    pub(crate) fn argument(text: impl Into<String>) -> Failure {
        Failure { status: Status::Argument, text: text.into() }
    }

    /// A null pointer.
    pub(crate) fn null(name: &str) -> Failure {
        Failure::argument(format!("{name} is a null pointer"))
    }

    /// An error with its causes.
    fn of(status: Status, error: &dyn Error) -> Failure {
        let mut text = error.to_string();
        let mut cause = error.source();
        while let Some(error) = cause {
            let further = error.to_string();
            // Transparent errors repeat their cause.
            if !text.ends_with(&further) {
                text = format!("{text}: {further}");
            }
            cause = error.source();
        }
        Failure { status, text }
    }
}

impl From<LoadError> for Failure {
    fn from(error: LoadError) -> Self {
        let status = if matches!(error, LoadError::Limit(_)) { Status::Limit } else { Status::File };
        Failure::of(status, &error)
    }
}

impl From<RegionError> for Failure {
    fn from(error: RegionError) -> Self {
        Failure::of(Status::Region, &error)
    }
}

impl From<BytesError> for Failure {
    fn from(error: BytesError) -> Self {
        let status = if matches!(error, BytesError::Region(_)) { Status::Region } else { Status::Argument };
        Failure::of(status, &error)
    }
}

impl From<EncodeError> for Failure {
    fn from(error: EncodeError) -> Self {
        let status = match error {
            EncodeError::Cancelled => Status::Cancelled,
            EncodeError::Limit(_) => Status::Limit,
            EncodeError::Params(_) => Status::Argument,
            _ => Status::Encode,
        };
        Failure::of(status, &error)
    }
}

impl From<NameError> for Failure {
    fn from(error: NameError) -> Self {
        Failure::of(Status::Argument, &error)
    }
}

impl From<DctProgramError> for Failure {
    fn from(error: DctProgramError) -> Self {
        Failure::of(Status::Region, &error)
    }
}

thread_local! {
    static LAST: RefCell<CString> = RefCell::default();
}

/// Text of the last failure of a function that this thread called, with its remedy; empty before the first one. It is valid until the
/// thread's next failure.
#[unsafe(no_mangle)]
pub extern "C" fn texfold_error() -> *const c_char {
    LAST.with_borrow(|last| last.as_ptr())
}

/// Calls what a function does; keeps the text of its failure.
pub(crate) fn guarded(work: impl FnOnce() -> Outcome<()>) -> Status {
    let failure = match catch_unwind(AssertUnwindSafe(work)) {
        Ok(Ok(())) => return Status::Ok,
        Ok(Err(failure)) => failure,
        Err(_) => Failure {
            status: Status::Fault,
            text: "a fault inside of the library; report the file or the images".to_owned(),
        },
    };
    let text = kept(&failure.text);
    LAST.with_borrow_mut(|last| *last = text);
    failure.status
}

/// What a pointer points to.
///
/// # Safety
/// It is null or points to a `T` for as long as the reference lives.
pub(crate) unsafe fn there<'a, T>(pointer: *const T, name: &str) -> Outcome<&'a T> {
    // SAFETY: as for this function.
    unsafe { pointer.as_ref() }.ok_or_else(|| Failure::null(name))
}

/// Writes a result.
///
/// # Safety
/// The pointer is null or points to room for a `T`.
pub(crate) unsafe fn put<T>(pointer: *mut T, value: T, name: &str) -> Outcome<()> {
    if pointer.is_null() {
        return Err(Failure::null(name));
    }
    // SAFETY: it is not null, and what was there needs no drop.
    unsafe { pointer.write(value) };
    Ok(())
}

/// So many values; none where there are to be none, whatever the pointer is.
///
/// # Safety
/// The pointer is null or points to `count` values for as long as the slice lives.
pub(crate) unsafe fn values<'a, T>(pointer: *const T, count: usize, name: &str) -> Outcome<&'a [T]> {
    if count == 0 {
        return Ok(&[]);
    }
    check_values(pointer, count, name)?;
    // SAFETY: not null, aligned, no more than the address space; otherwise as for this function.
    Ok(unsafe { std::slice::from_raw_parts(pointer, count) })
}

/// As [`values`], to be written.
///
/// # Safety
/// The pointer is null or points to `count` values that nobody else reads for as long as the slice lives.
pub(crate) unsafe fn values_mut<'a, T>(pointer: *mut T, count: usize, name: &str) -> Outcome<&'a mut [T]> {
    if count == 0 {
        return Ok(&mut []);
    }
    check_values(pointer, count, name)?;
    // SAFETY: not null, aligned, no more than the address space; otherwise as for this function.
    Ok(unsafe { std::slice::from_raw_parts_mut(pointer, count) })
}

fn check_values<T>(pointer: *const T, count: usize, name: &str) -> Outcome<()> {
    if pointer.is_null() {
        return Err(Failure::null(name));
    }
    if !pointer.is_aligned() {
        return Err(Failure::argument(format!("{name} is not aligned to {} bytes", align_of::<T>())));
    }
    if count > isize::MAX as usize / size_of::<T>().max(1) {
        return Err(Failure::argument(format!("{name}: {count} values are more than memory can hold")));
    }
    Ok(())
}

/// A text; `None` for a null pointer.
///
/// # Safety
/// The pointer is null or points to a string that ends with a 0 for as long as the text lives.
pub(crate) unsafe fn text<'a>(pointer: *const c_char, name: &str) -> Outcome<Option<&'a str>> {
    if pointer.is_null() {
        return Ok(None);
    }
    // SAFETY: as for this function.
    let text = unsafe { CStr::from_ptr(pointer) }.to_str();
    text.map(Some).map_err(|_| Failure::argument(format!("{name} is not UTF-8")))
}

/// A string for C that an object keeps.
pub(crate) fn kept(text: &str) -> CString {
    CString::new(text.replace('\0', " ")).unwrap_or_default()
}
