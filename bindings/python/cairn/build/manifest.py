"""The manifest `cairn-world.json`: `docs/bundle.md`, sections 2 and 3."""

from __future__ import annotations

import unicodedata
from dataclasses import dataclass
from pathlib import Path

from .errors import BuildError
from .geometry import AUTOENCODER_TEMPORAL, Geometry
from .quantise import Quantisation

MANIFEST_FILE = "cairn-world.json"
SCHEMA_VERSION = 1
MODEL_TYPE = "waypoint-1.5"
MANIFEST_LIMIT = 1 << 20
NAME_LIMIT = 100
SPDX_LIMIT = 200
# Of noise levels, and of Fourier and RoPE frequencies.
ROUNDINGS = ("none", "bf16")


@dataclass(frozen=True)
class Licence:
    """Terms of the weights: an SPDX expression, and optionally the text, in any encoding, and its file name in the bundle."""

    spdx: str
    text: bytes | None = None
    file: str = "LICENSE.txt"

    @staticmethod
    def read(spdx: str, path: Path) -> "Licence":
        """A licence with the text of a file."""
        return Licence(spdx, path.read_bytes())


def check_texts(name: str, provenance: dict[str, str], licence: Licence, rounding: str) -> None:
    """Checks the texts of a manifest, as the library does: `docs/bundle.md`, section 2."""
    _check_text("name", name, NAME_LIMIT)
    if any(unicodedata.category(letter) == "Cc" for letter in name):
        raise BuildError(f"{name!r} has a control character", field="name", remedy="Leave it out.")
    _check_text("licence", licence.spdx, SPDX_LIMIT)
    if not (licence.spdx.isascii() and licence.spdx.isprintable()):
        cause = f"{licence.spdx!r} has a character that is not printable ASCII"
        raise BuildError(cause, field="licence", remedy="Give an SPDX expression, such as Apache-2.0.")
    for member, value in provenance.items():
        _check_text("provenance", member, MANIFEST_LIMIT)
        _check_text(f"provenance.{member}", value, MANIFEST_LIMIT, shortest=0)
    _check_rounding("rounding", rounding)


def _check_rounding(field: str, value: object) -> None:
    if value not in ROUNDINGS:
        raise BuildError(f"{value!r:.50} is none of {', '.join(ROUNDINGS)}", field=field, remedy="Choose one of these.")


def _check_text(field: str, value: object, limit: int, shortest: int = 1) -> None:
    """Checks the type and the length of a text, and that it can be written as UTF-8: undecodable bytes of a file name cannot."""
    if not isinstance(value, str):
        raise BuildError(f"{value!r:.100} is no text", field=field, remedy="Give a text.")
    if not shortest <= len(value) <= limit:
        cause = f"{value!r:.120} has {len(value)} characters, {shortest} to {limit} are allowed"
        raise BuildError(cause, field=field, remedy="Give another one.")
    try:
        value.encode()
    except UnicodeEncodeError as error:
        raise BuildError(f"{value!r:.120} is no Unicode text", field=field, remedy="Give another one.") from error


def manifest(
    g: Geometry,
    *,
    name: str,
    graphs: dict[str, dict[str, str]],
    files: dict[str, tuple[int, str]],
    licence: Licence,
    provenance: dict[str, str],
    rounding: str,
    quantisation: Quantisation | None = None,
) -> dict:
    """The whole manifest; `files` maps a path to its size and SHA-256. `rounding` is that of noise levels and RoPE frequencies."""
    return {
        "schema_version": SCHEMA_VERSION,
        "name": name,
        "model_type": MODEL_TYPE,
        "geometry": {
            "layers": g.layers,
            "width": g.width,
            "heads": g.heads,
            "kv_heads": g.kv_heads,
            "head_width": g.head_width,
            "mlp_ratio": g.mlp_ratio,
            "latent": {"channels": g.latent_channels, "height": g.latent_height, "width": g.latent_width},
            "patch": list(g.patch),
            "tokens": g.tokens,
            "local": {"window": g.local_window},
            "global": {
                "window": g.global_window,
                "dilation": g.global_dilation,
                "max_window": g.global_max_window,
                "period": g.global_period,
                "offset": g.global_offset,
            },
            "control_period": g.control_period,
            "rope": {"nyquist_fraction": g.nyquist_fraction, "time_base": g.time_base, "rounding": rounding},
            "autoencoder": {
                "temporal": AUTOENCODER_TEMPORAL,
                "spatial": g.spatial,
                "memories": [list(m) for m in g.memories],
                **({"encoder_memories": [list(m) for m in g.encoder_memories]} if g.streaming_encoder else {}),
            },
        },
        "sampler": {"schedule": list(g.schedule), "sigma_rounding": rounding},
        "rates": {"latents_per_second": g.latents_per_second, "time_multiplier": g.time_multiplier},
        "controls": {"mouse": 2, "buttons": g.buttons, "scroll": 1},
        "picture": {"decoded": list(g.decoded), "render": list(g.render), "range": [0, 1]},
        "graphs": graphs,
        **({} if g.residual == "float16" else {"residual": g.residual}),
        **({} if quantisation is None else {"quantisation": quantisation.manifest()}),
        "files": [{"path": path, "size": size, "sha256": sha} for path, (size, sha) in sorted(files.items())],
        "licence": {"spdx": licence.spdx, "file": licence.file if licence.text is not None else None},
        "provenance": provenance,
    }


def geometry_of(content: dict) -> Geometry:
    """The shapes in a manifest. Those that only the graphs contain (the encoder's widths and the last width) keep their defaults."""
    try:
        _check_rounding("geometry.rope.rounding", content["geometry"]["rope"]["rounding"])
        _check_rounding("sampler.sigma_rounding", content["sampler"]["sigma_rounding"])
        g, latent, wide = content["geometry"], content["geometry"]["latent"], content["geometry"]["global"]
        memories = g["autoencoder"]["memories"]
        stages = [memories[i][0] for i in (0, 3, 6)]
        return Geometry(
            layers=g["layers"],
            width=g["width"],
            heads=g["heads"],
            kv_heads=g["kv_heads"],
            latent_channels=latent["channels"],
            latent_height=latent["height"],
            latent_width=latent["width"],
            patch=tuple(g["patch"]),
            mlp_ratio=g["mlp_ratio"],
            local_window=g["local"]["window"],
            global_window=wide["window"],
            global_dilation=wide["dilation"],
            global_max_window=wide["max_window"],
            global_period=wide["period"],
            global_offset=wide["offset"],
            control_period=g["control_period"],
            nyquist_fraction=g["rope"]["nyquist_fraction"],
            time_base=g["rope"]["time_base"],
            latents_per_second=content["rates"]["latents_per_second"],
            time_multiplier=content["rates"]["time_multiplier"],
            schedule=tuple(content["sampler"]["schedule"]),
            decoder_widths=(*stages, stages[2]),
            streaming_encoder=bool(g["autoencoder"].get("encoder_memories")),
            render=tuple(content["picture"]["render"]),
            residual=content.get("residual", "float16"),
            joined="joined" in content["graphs"]["f32"],
        )
    except (KeyError, IndexError, TypeError, AttributeError) as error:
        cause = f"a member is missing or of another kind: {error!r}"
        raise BuildError(cause, field=MANIFEST_FILE, remedy="See docs/bundle.md.") from error
