//! `cargo xtask`: the one place that knows how things are run in this clone. `cargo xtask help` is its manual.

mod abi;
mod cli;
mod clone;
mod demo;
mod shell;
mod test;

use std::process::ExitCode;

use clap::Parser;

use cli::{Cli, Command};
use clone::Clone;

fn main() -> ExitCode {
    let cli = Cli::parse();
    let result = Clone::find().and_then(|clone| match cli.command {
        Command::Setup { all } => demo::setup(&clone, all).map(|()| true),
        Command::Demo { arguments } => demo::run(&clone, &arguments).map(|()| true),
        Command::Test(options) => test::run(&clone, &options),
        Command::Bench { arguments } => demo::bench(&clone, &arguments).map(|()| true),
        Command::Fix { abi: true } => abi::fix(&clone).map(|()| true),
        Command::Fix { abi: false } => demo::fix(&clone).map(|()| true),
    });
    match result {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(why) => {
            eprintln!("\nerror: {why}");
            ExitCode::FAILURE
        }
    }
}
