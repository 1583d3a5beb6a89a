//! The command `mmae`; see [`mmae::cli`].

fn main() -> std::process::ExitCode {
    mmae::cli::main()
}
