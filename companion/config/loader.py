"""The configuration: TOML in, a frozen `Config` out; all mistakes are reported at once, with its key and its remedy.

The sections are the fields of plain dataclasses whose metadata hold range, unit and meaning ({"min", "max", "unit",
"doc"} or "choices"): nothing is listed twice. Angles are degrees here and on the command line, nowhere else.
"""

from __future__ import annotations

import json
import logging
import os
import pwd
import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from core.open_sky_params import OpenSkyParams
from core.params import Params
from core.self_check.mount_params import MountCheckParams
from core.tracking.params import TrackingParams
from core.world.params import WorldParams
from drivers.regular_file import regular

from ..packaged import shipped_configs
from .avoidance import AvoidParams
from .camera import CameraConfig, OutputConfig
from .camera_kinds import RECORDED
from .file_model import file_model
from .guard import GuardParams
from .mistakes import TOO_DEEP, TOO_LONG, mistake_text
from .retired import refused_values, without_retired
from .sections import SECTIONS, fields_of
from .service import AutopilotConfig, PublishConfig, RecordParams, ServiceParams, SupervisorParams
from .share import AUTOPILOT_LINE, ShareConfig
from .sync import SyncParams

log = logging.getLogger(__name__)

_COMBINED = ("extractor", "expert", "camera")
"""Sections that are not one field of `Config` each."""
MAX_BYTES = 1_000_000
"""Of a configuration file; a log given by mistake can be of gigabytes."""
NOT_UTF_8 = "not a text file in UTF-8; a configuration is a TOML file: save it with the encoding UTF-8"
MAX_BLIND_DELAY_S = 0.4
"""After the newest exposure, so late at most: no setting may make it later."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Config:
    """The effective configuration. Raises ValueError when two cameras have the same name, and where autopilots would not
    receive the loss of depth in time."""

    extractor: Params = field(default_factory=Params)
    open_sky: OpenSkyParams = field(default_factory=OpenSkyParams)
    sync: SyncParams = field(default_factory=SyncParams)
    mount_check: MountCheckParams = field(default_factory=MountCheckParams)
    cameras: tuple[CameraConfig, ...] = ()
    output: OutputConfig = field(default_factory=OutputConfig)
    autopilot: AutopilotConfig = field(default_factory=AutopilotConfig)
    avoid: AvoidParams = field(default_factory=AvoidParams)
    guard: GuardParams = field(default_factory=GuardParams)
    publish: PublishConfig = field(default_factory=PublishConfig)
    world: WorldParams = field(default_factory=WorldParams)
    tracking: TrackingParams = field(default_factory=TrackingParams)
    share: ShareConfig = field(default_factory=ShareConfig)
    record: RecordParams = field(default_factory=RecordParams)
    supervision: SupervisorParams = field(default_factory=SupervisorParams)
    service: ServiceParams = field(default_factory=ServiceParams)

    def __post_init__(self) -> None:
        names = [c.name for c in self.cameras]
        for name in sorted({n for n in names if names.count(n) > 1}):
            raise ValueError(f"[[camera]] name = {name!r} occurs {names.count(name)} times; give each camera its own")
        if self.open_sky.presumes:
            check_open_sky(self)
        if self.share.enabled:
            check_share(self)
        if self.avoid.send and not self.autopilot.address:
            raise ValueError("[avoid] send = true, but [autopilot] address is empty, so nothing could be sent; set one")
        if self.guard.enabled and not self.avoid.send:
            raise ValueError(
                "[guard] enabled = true, but [avoid] send = false: the guard uses the distances of the obstacle output; set "
                "[avoid] send = true"
            )
        if self.guard.enabled and self.avoid.near_m >= self.guard.horizon_m:
            raise ValueError(
                f"[guard] horizon_m = {self.guard.horizon_m:g} is not greater than [avoid] near_m = {self.avoid.near_m:g}, from "
                "which on the path must be seen free, so that the guard would stop the vehicle everywhere; raise horizon_m"
            )
        if self.avoid.send and self.service.timeout_s + 1.0 / self.avoid.rate_hz > MAX_BLIND_DELAY_S + 1e-9:
            raise ValueError(
                f"[service] timeout_s = {self.service.timeout_s:g} with [avoid] rate_hz = {self.avoid.rate_hz:g}: blindness must "
                f"be sent to the autopilot within {MAX_BLIND_DELAY_S:g} s; set timeout_s to 0.3 or less"
            )

    def camera(self, name: str) -> CameraConfig:
        """The section of a camera; one that changes nothing where there is none."""
        return next((c for c in self.cameras if c.name == name), CameraConfig(name=name))


def check_share(config: Config) -> None:
    """Raises ValueError where obstacles are to be shared and cannot be."""
    share = config.share
    if not config.publish.world:
        raise ValueError(
            "[share] enabled = true, but [publish] world is empty, so there is no merged world to share; set world and "
            "world_requests"
        )
    if not share.tunnel and not share.zenoh:
        raise ValueError("[share] enabled = true without a link to other vehicles; set tunnel or zenoh")
    if not config.autopilot.address:
        raise ValueError("[share] enabled = true, but [autopilot] address is empty, so there is no position; set one")
    if share.tunnel == AUTOPILOT_LINE and share.vehicle:
        raise ValueError(
            f'[share] vehicle = {share.vehicle} with tunnel = "{AUTOPILOT_LINE}": that line sends with the system id of the '
            "vehicle; set vehicle = 0"
        )


def check_open_sky(config: Config) -> None:
    """Raises ValueError where open space is to be presumed and none of its evidence can ever be there. Of a recording
    (kind = "mcap", or no camera) the log says whether its camera wrote marks."""
    if not config.mount_check.enabled:
        raise ValueError(
            '[open_sky] mode = "presume" with [mount_check] enabled = false: nothing is presumed free before the mount is '
            'verified; set enabled = true, or mode = "off"'
        )
    if all(not c.marks_smooth and c.kind != RECORDED for c in config.cameras) and config.cameras:
        raise ValueError(
            '[open_sky] mode = "presume" needs the marks of a stereo camera, and no [[camera]] writes the marks: '
            f"{'; '.join(_why_unmarked(c) for c in config.cameras)}"
        )


def _why_unmarked(camera: CameraConfig) -> str:
    """Why the depth images of a camera bear no marks."""
    if camera.can_mark:
        return f'"{camera.name}" has mark_smooth = false; set it to true'
    if camera.kind == "oak":
        return f'"{camera.name}" is matched on the device; set match_on = "host" and mark_smooth = true'
    return f'"{camera.name}" of kind "{camera.kind}" delivers matched depth, so mark_smooth has no effect'


class ConfigError(Exception):
    """A configuration that cannot be used: `problems` holds one line for each mistake. remedy: for all of them."""

    def __init__(self, source: str, problems: Sequence[str], remedy: str = "") -> None:
        self.source, self.problems = source, tuple(problems)
        count = "1 mistake" if len(problems) == 1 else f"{len(problems)} mistakes"
        lines = [f"{source}: {count}", *(f"  {p}" for p in problems), remedy]
        super().__init__("\n".join(line for line in lines if line))


def load_config(path: Path) -> Config:
    """The configuration in a TOML file; logs a warning for each key of an earlier version. Raises ConfigError."""
    try:
        with regular(path).open("rb") as stream:
            raw = stream.read(MAX_BYTES + 1)
        text = raw.decode("utf-8-sig")  # some editors put a mark before the text
    except UnicodeDecodeError as error:
        raise ConfigError(str(path), [NOT_UTF_8]) from error
    except OSError as error:
        problem = f"cannot be read ({error.strerror}); {_remedy(path, error)}"
        raise ConfigError(str(path), [problem]) from error
    if "\0" in text:  # UTF-16 without a mark, or a binary file
        raise ConfigError(str(path), [NOT_UTF_8])
    if len(raw) > MAX_BYTES:
        raise ConfigError(
            str(path), [f"larger than {MAX_BYTES // 1_000_000} MB; give a configuration, which is a short TOML file"]
        )
    try:
        content = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        problem = f"not valid TOML: {error}; {_toml_remedy(str(error))}"
        raise ConfigError(str(path), [problem]) from error
    except ValueError as error:  # Python reads numbers of up to 4300 digits
        raise ConfigError(str(path), [TOO_LONG]) from error
    except RecursionError as error:
        raise ConfigError(str(path), [f"{TOO_DEEP}; a configuration has sections and keys only"]) from error
    if problems := refused_values(content):
        raise ConfigError(str(path), problems)
    current, warnings = without_retired(content)
    for warning in warnings:
        log.warning("%s: %s", path, warning)
    return config_of(current, str(path))


def _toml_remedy(error: str) -> str:
    """What to do about a text that is not TOML. error: the message of tomllib."""
    if "twice" in error or "overwrite" in error:
        return "a section or a key stands there twice: put all keys of a section under one header"
    if "Unescaped" in error:
        return "in double quotes a backslash begins an escape: use single quotes"
    return "strings need quotes; true and false are in lower case; decimals have a dot, with a digit on both sides"


def _remedy(path: Path, error: OSError) -> str:
    """What to do about a configuration that cannot be read."""
    if isinstance(error, PermissionError):
        return f"give the user {_user()} the permission to read it and its folders"
    if isinstance(error, IsADirectoryError):
        return "give the TOML file in it"
    if isinstance(error, FileNotFoundError) and path.suffix in ("", ".toml") and path.stem in shipped_configs():
        return f"{path.stem} is a shipped configuration: `companion configs {path.stem}` copies it to {path.stem}.toml"
    return "check the path; `companion configs` lists examples"


def _user() -> str:
    """Name of the user of this process; its number where it has no name."""
    try:
        return pwd.getpwuid(os.geteuid()).pw_name
    except KeyError:
        return str(os.geteuid())


def config_text(config: Config) -> str:
    """The effective configuration as JSON, every key written out; the same text for the same configuration."""
    content: dict[str, Any] = {
        name: {f.name: getattr(values_of(config, name), f.name) for f in fields_of(name)}
        for name in SECTIONS
        if name != "camera"
    }
    content["camera"] = [{k: v for k, v in asdict(c).items() if v is not None} for c in config.cameras]
    return json.dumps(content, sort_keys=True, indent=1, allow_nan=False)


def config_from_text(text: str, source: str = "the configuration in the log") -> Config:
    """The configuration that `config_text` wrote. Raises ConfigError."""
    try:
        content = json.loads(text)
    except ValueError as error:
        raise ConfigError(source, [f"not valid JSON: {error}; the log is damaged"]) from error
    except RecursionError as error:
        raise ConfigError(source, [f"{TOO_DEEP}; the log is damaged"]) from error
    if not isinstance(content, dict):
        raise ConfigError(source, ["not an object of sections; the log is damaged"])
    if problems := refused_values(content, in_log=True):
        raise ConfigError(source, problems)
    return config_of(without_retired(content)[0], source)


def config_of(content: Mapping[str, Any], source: str) -> Config:
    """The configuration of nested tables as TOML and JSON give them. Raises ConfigError with all mistakes."""
    try:
        valid = file_model(frozenset(content) & frozenset(SECTIONS)).model_validate(dict(content)).model_dump()
    except ValidationError as error:
        raise ConfigError(source, [mistake_text(e) for e in error.errors(include_url=False)]) from error
    problems: list[str] = []  # what concerns several keys at once

    def made(kind: Callable[..., Any], values: Mapping[str, Any]) -> Any:
        try:
            return kind(**values)
        except ValueError as error:
            problems.append(str(error))
            return None

    sections = {name: made(kind, valid.get(name, {})) for name, kind in SECTIONS.items() if name not in _COMBINED}
    sections["extractor"] = made(Params, valid.get("extractor", {}) | valid.get("expert", {}))
    sections["cameras"] = tuple(made(CameraConfig, section) for section in valid.get("camera", ()))
    config: Config | None = None if problems else made(Config, sections)
    if config is None:
        raise ConfigError(source, problems)
    return config


def values_of(config: Config, section: str) -> Any:
    """The object with the values of a section, other than `camera`."""
    return config.extractor if section == "expert" else getattr(config, section)
