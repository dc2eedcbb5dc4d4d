//! Texfold's command line as a library: files, batches, reports
