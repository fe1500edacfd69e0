//! LPIPS with its weights.

use std::path::PathBuf;
use std::sync::LazyLock;

use study::metrics::{Lpips, Net};

/// With the weights from where `CAIRN_LPIPS` says, else fetched as `cargo xtask setup --all` does.
pub fn lpips(net: Net) -> &'static Lpips {
    static ALEX: LazyLock<Lpips> = LazyLock::new(|| load(Net::Alex, "alexnet.ckpt"));
    static VGG: LazyLock<Lpips> = LazyLock::new(|| load(Net::Vgg, "vgg16.ckpt"));
    match net {
        Net::Alex => &ALEX,
        Net::Vgg => &VGG,
    }
}

fn load(net: Net, file: &str) -> Lpips {
    let folder = match std::env::var_os("CAIRN_LPIPS").filter(|folder| !folder.is_empty()) {
        Some(folder) => PathBuf::from(folder),
        None => provision::lpips_weights(&provision::Console::new()).unwrap_or_else(|e| panic!("{e}")),
    };
    Lpips::load(net, &folder.join(file)).unwrap_or_else(|e| panic!("{e}"))
}
