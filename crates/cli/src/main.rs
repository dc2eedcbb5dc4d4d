//! The `texfold` command.
fn main() -> std::process::ExitCode {
    texfold_cli::main()
}
