//! `study pages`.

use std::process::ExitCode;

use cairn::Result;
use clap::Args;

use super::{Subcommand, print_outcome};
use crate::experiment::provenance;

#[derive(Args)]
pub(super) struct PagesArgs {
    /// Change pages that an older generator or another world made so that they say so
    #[arg(long)]
    mark: bool,
}

impl Subcommand for PagesArgs {
    fn run(&self) -> Result<ExitCode> {
        let pages = provenance::pages(self.mark)?;
        print_outcome(&pages.iter().map(|page| format!("{}\n", page.line)).collect::<String>(), &[]);
        Ok(ExitCode::from(u8::from(pages.iter().any(|page| page.is_wrong))))
    }
}
