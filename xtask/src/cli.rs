//! The command line.

use clap::{Args, Parser, Subcommand};

/// Set up, demonstrate, test and measure Cairn.
#[derive(Debug, Parser)]
#[command(
    name = "cargo xtask",
    bin_name = "cargo xtask",
    arg_required_else_help = true,
    after_help = "A first visit:\n  cargo xtask demo           see it run: target/demo/ holds videos, pictures and manifests\n  \
                  cargo xtask test           run every test; the last line sums them up\n\nWhile working:\n  \
                  cargo xtask fix            format, and apply what clippy can mend\n  \
                  cargo xtask test clippy    run only the runners whose name holds \"clippy\"\n  \
                  cargo xtask test --list    show the runners\n\n\
                  Needs rustup, Python 3.11 or newer with pip, and a C compiler; all else is fetched once, by package\n\
                  name, into the user's cache directory (CAIRN_CACHE_DIR puts it elsewhere)."
)]
pub(crate) struct Cli {
    #[command(subcommand)]
    pub(crate) command: Command,
}

#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// Fetch what the demo needs: ONNX Runtime, a Python environment, a random-weight world, nasm where apt has it
    Setup {
        /// Fetch what the tests need as well: the test worlds, the weights of LPIPS, the Windows target with a linker, cargo-deny
        #[arg(long)]
        all: bool,
    },
    /// Set up, then make four seconds of a world and two of frame generation; says which files to open
    Demo {
        /// Handed on to `study demo`
        #[arg(last = true)]
        arguments: Vec<String>,
    },
    /// Run every test and sum them up; the exit status is 0 when nothing failed
    Test(TestOptions),
    /// Measure what the runtime costs over bare ONNX Runtime, as ratios of one run
    Bench {
        /// Handed on to the bench program
        #[arg(last = true)]
        arguments: Vec<String>,
    },
    /// Format the code, apply what clippy can mend by itself, and write the C headers and abi.txt anew
    Fix {
        /// Only write the C headers and abi.txt
        #[arg(long)]
        abi: bool,
    },
}

#[derive(Debug, Args)]
#[command(after_help = "With CI=true a skipped test that xtask/skips.toml does not allow counts as a failure.\n\
                        Logs are kept in target/xtask/.")]
pub(crate) struct TestOptions {
    /// Fuzz every target for a minute, and run every fault and the long soak as well
    #[arg(long)]
    pub(crate) thorough: bool,
    /// Show the runners and what each does, and run none
    #[arg(long)]
    pub(crate) list: bool,
    /// Run only runners whose name holds one of these words
    #[arg(value_name = "FILTER")]
    pub(crate) filters: Vec<String>,
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    use super::*;

    #[test]
    fn the_command_line_is_consistent() {
        Cli::command().debug_assert();
    }
}
