//! The command line.

use std::ffi::OsString;
use std::path::PathBuf;

use clap::{Args, Parser, Subcommand};

use crate::dist::Platform;

/// Set up, demonstrate, test and measure Cairn.
#[derive(Debug, Parser)]
#[command(
    name = "cargo xtask",
    bin_name = "cargo xtask",
    arg_required_else_help = true,
    after_help = "A first visit:\n  cargo xtask demo           see it run: target/demo/ holds videos, pictures and manifests\n  \
                  cargo xtask test           run the tests of every change; the last line sums them up\n\nWhile working:\n  \
                  cargo xtask fix            format, and apply what clippy can mend\n  \
                  cargo xtask test clippy    run only the runners whose name holds \"clippy\"\n  \
                  cargo xtask test --list    show the runners\n\n\
                  Needs rustup, Python 3.11 to 3.14 with pip, and a C compiler; all else is fetched once, by package\n\
                  name, into the user's cache directory (CAIRN_CACHE_DIR puts it elsewhere)."
)]
pub(crate) struct Cli {
    #[command(subcommand)]
    pub(crate) command: Command,
}

#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// Fetch what the demo needs: ONNX Runtime, nasm where apt has it
    Setup {
        /// Fetch what the tests need as well: the test worlds, ONNX Runtime with its WebGPU provider and its newest version, the weights of LPIPS, the Windows target with a linker, Mono and .NET, cargo-deny, mdBook
        #[arg(long)]
        all: bool,
    },
    /// Set up, then film the world's four levels, make four seconds of a rollout and two of frame generation; says which files to open
    Demo {
        /// Passed to `study demo`
        #[arg(last = true)]
        arguments: Vec<String>,
    },
    /// Run the tests of every change and sum them up; the exit status is 0 when nothing failed. `--list` also shows further parts
    Test(TestOptions),
    /// Measure what the runtime costs over bare ONNX Runtime, as ratios of one run
    Bench {
        /// Measure the compute shaders and latent steps on Direct3D 12 instead, in the lab or on Windows
        #[arg(long)]
        lab: bool,
        /// Count instead what a latent step of the world inside the library runs, below DirectML, and print the tables of docs/counts.md
        #[arg(long, requires = "lab")]
        count: bool,
        /// Write the counts to xtask/counts.toml and docs/counts.md; `test recorder` fails where one rises by 2 % or more
        #[arg(long, requires = "count")]
        publish: bool,
        /// Passed to the bench program
        #[arg(last = true, conflicts_with = "count")]
        arguments: Vec<String>,
    },
    /// Make a Windows with Direct3D 12 and DirectML on this Linux machine, and run programs in it
    #[command(
        after_help = "Without a command the lab is built, or found: Wine and a software Vulkan driver in a Debian of their\n\
                            own, some five minutes and 2.5 GB in the user's cache directory, once; what is interrupted goes on\n\
                            where it was. Needs root (mounting), apt-get with a Debian mirror in its configuration, or one in\n\
                            CAIRN_DEBIAN_MIRROR.\n\n\
                            Examples:\n  \
                              cargo xtask lab                           build it\n  \
                              cargo xtask lab run host.exe --frames 30  run a program in it\n  \
                              CARGO_TARGET_X86_64_PC_WINDOWS_GNU_RUNNER=\"cargo xtask lab run\" \\\n    \
                                cargo test --target x86_64-pc-windows-gnu --package cairn --test d3d12"
    )]
    Lab {
        #[command(subcommand)]
        command: Option<LabCommand>,
    },
    /// Make a book of the documentation: target/book/html/index.html
    Book,
    /// Compile the library's shaders to the DXBC that it carries, with Microsoft's compiler in the lab or on Windows
    Shaders,
    /// Pack the library with headers, bindings, samples, licences and `cairn-check`: archives and Python wheels that a project takes it from
    Dist(DistOptions),
    /// Format the code, apply what clippy can mend by itself, and write the C headers, abi.txt and C#'s declarations anew
    Fix {
        /// Only write the C headers, abi.txt and C#'s declarations
        #[arg(long)]
        abi: bool,
    },
}

#[derive(Debug, Args)]
#[command(
    after_help = "Writes cairn-VERSION-windows-x64.zip, the same without Microsoft's libraries (-slim), cairn-VERSION-linux-x64.tar.gz,\n\
                        a Python wheel for each of the two, and SHA256SUMS. The same commit and compiler make the same bytes, wherever the clone lies; SOURCE_DATE_EPOCH sets\n\
                        the time of the files, which is the commit's otherwise.\n\n\
                        Examples:\n  \
                          cargo xtask dist\n  \
                          cargo xtask dist --wheels\n  \
                          cargo xtask dist windows-x64 --out D"
)]
pub(crate) struct DistOptions {
    /// What for [default: all]
    #[arg(value_name = "PLATFORM", value_enum)]
    pub(crate) platforms: Vec<Platform>,
    /// Only the Python wheels
    #[arg(long)]
    pub(crate) wheels: bool,
    /// Folder for the archives [default: target/dist]
    #[arg(long, value_name = "DIR")]
    pub(crate) out: Option<PathBuf>,
}

#[derive(Debug, Subcommand)]
pub(crate) enum LabCommand {
    /// Run a Windows program, or a Linux program on the lab's Vulkan driver; the lab is built first where it is missing
    #[command(
        after_help = "Working directory, arguments, variables, standard streams and the exit status are the program's own; paths\n\
                            mean what they mean outside, and the machine's root is the drive Z:. Of an exit status the lowest\n\
                            eight bits come through, and 1 where these alone are 0. A display is there while it runs. All that\n\
                            it starts ends with it, also after Ctrl-C; what it writes to C: is gone afterwards, and the\n\
                            machine's /usr, /etc, /var and /run are not seen.\n\n\
                            Wine's remarks are off: WINEDEBUG=err+all, VKD3D_DEBUG=warn show them. On Windows the program runs\n\
                            as it is.\n\n\
                            A Linux program runs without Wine and without a display, on the lab's software Vulkan driver."
    )]
    Run {
        /// The program, a path of this machine, and its arguments, handed on as they are
        // One list: with a separate argument for the program, its own first option would be read as an option of this command.
        #[arg(required = true, num_args = 1.., trailing_var_arg = true, value_name = "PROGRAM [ARG]")]
        command: Vec<OsString>,
    },
}

#[derive(Debug, Args)]
#[command(after_help = "With CI=true a skipped test that xtask/skips.toml does not allow counts as a failure.\n\
                        Logs are kept in target/xtask/.")]
pub(crate) struct TestOptions {
    /// Run the thorough parts as well: fuzzing, every fault, soaks, all of DirectML; name one, as together they take hours
    #[arg(long)]
    pub(crate) thorough: bool,
    /// Append the results of thorough parts, with date, commit and duration, to xtask/thorough.toml and docs/thorough.md
    #[arg(long, requires = "thorough")]
    pub(crate) record: bool,
    /// Show the runners, what each does and how long the thorough parts take, and run none
    #[arg(long)]
    pub(crate) list: bool,
    /// Run only runners whose name holds one of these words; a whole name chooses that runner alone
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

    #[test]
    fn arguments_after_a_program_are_passed_on() {
        let given = ["a.exe", "--help", "-V", "--", "--all", "-"];
        let parsed = Cli::try_parse_from(["xtask", "lab", "run"].into_iter().chain(given)).expect("a command");
        let Command::Lab { command: Some(LabCommand::Run { command }) } = parsed.command else {
            panic!("another command: {:?}", parsed.command);
        };
        assert_eq!(command, given);
        // Without a program the option is this command's.
        let help = Cli::try_parse_from(["xtask", "lab", "run", "--help"]).expect_err("its help");
        assert_eq!(help.kind(), clap::error::ErrorKind::DisplayHelp);
        assert!(Cli::try_parse_from(["xtask", "lab", "run"]).is_err());
    }
}
