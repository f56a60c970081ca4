fn main() -> std::process::ExitCode {
    hairlight::cli::main()
}
