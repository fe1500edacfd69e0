//! Settings of a run, which every check gets.

/// What a check may vary by.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(crate) struct Settings {
    /// Smaller pictures and fewer repetitions: shows that everything runs, and measures nothing worth comparing.
    pub(crate) short: bool,
    /// Index of the adapter in the list of adapters; `None` for the first that is not a software adapter.
    pub(crate) adapter: Option<usize>,
}

impl Settings {
    /// The same as arguments of the program.
    pub(crate) fn arguments(&self) -> Vec<String> {
        let mut arguments: Vec<String> = self.short.then(|| "--short".to_owned()).into_iter().collect();
        if let Some(adapter) = self.adapter {
            arguments.extend(["--adapter".to_owned(), adapter.to_string()]);
        }
        arguments
    }

    /// One of two values, by whether the run is short.
    #[cfg(windows)]
    pub(crate) fn pick<T>(&self, whole: T, short: T) -> T {
        if self.short { short } else { whole }
    }
}
