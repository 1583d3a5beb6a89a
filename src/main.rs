//! The command `mmae`.

fn main() -> std::process::ExitCode {
    std::process::ExitCode::SUCCESS
}
