"""`companion demo`: the flight, its output and files, and the processes that it starts and ends."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import sysconfig
import tomllib
from pathlib import Path

import pytest

from companion.cli import main
from companion.config.camera import CameraConfig
from companion.config.loader import Config, config_of, load_config
from companion.config.service import AutopilotConfig
from companion.demo.command import scripts_outside_path
from companion.demo.demo import CAMERA, EMBEDDED, MAX_FPS, DemoOptions, demo_config
from companion.demo.listener import ReceiveStats
from companion.demo.live import DemoError, LiveRun, Processes, live_config, toml_of
from companion.demo.sole_use import sole_use
from drivers.logs.reader import McapRecording
from osape_client.proto import osape_v1_pb2 as pb
from tests.waiting import until

from ..recorded import SMALL, recorded

pytestmark = pytest.mark.process

ROOT = Path(__file__).resolve().parents[3]


def test_the_demo_flies_the_service_and_makes_what_it_names(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """It deleted the folder logs of the user."""
    out = tmp_path / "out"
    log = out / "logs" / "flight.000.mcap"
    log.parent.mkdir(parents=True)
    log.write_text("the only copy")
    assert main(["demo", "--fast", "--seconds", "1", "-o", str(out)]) == 0
    output = capsys.readouterr().out
    for name in ("view/flight.html", "prisms.mcap", "view/*.png", "autopilot: PX4", "vertical planes", "bit for bit"):
        assert name in output
    assert (out / "view" / "flight.html").stat().st_size > 10_000
    assert len(list((out / "view").glob("*.png"))) >= 4
    assert log.read_text() == "the only copy"
    assert sorted(p.name for p in out.iterdir()) == ["logs", "prisms.mcap", "view"]
    with McapRecording(out / "prisms.mcap") as recording:
        results = [item.message for item in recording.messages("prisms")]
    assert sum(isinstance(m, pb.PrismsFrame) and m.valid for m in results) > 5


def flown_before(config: Config, folder: Path, duration_s: float, on_progress: object) -> LiveRun:
    """A small recorded flight in the place of one of the service, which takes twelve seconds of processor time."""
    recorded(folder / "demo-flight", SMALL)
    (log,) = (folder / "demo-flight").iterdir()
    return LiveRun(log=log, health=pb.Health(), received=ReceiveStats(valid=1), duration_s=duration_s)


def test_the_demo_keeps_what_it_may_not_replace_and_draws_its_page_alone_without_matplotlib(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """It replaced prisms.mcap. An installation without the extra `view` failed at its end."""
    monkeypatch.setitem(sys.modules, "matplotlib.backends.backend_agg", None)
    monkeypatch.setattr("companion.demo.demo.fly", flown_before)
    result = tmp_path / "prisms.mcap"
    result.write_text("the only copy")
    earlier = tmp_path / "view" / "frame_front_000001.png"
    earlier.parent.mkdir()
    earlier.write_text("of the replaced log")
    words = ["demo", "--fast", "--seconds", "1", "-o", str(tmp_path)]
    assert main(words) == 1
    assert f"{result} exists; give -o another name, or --replace" in capsys.readouterr().err
    assert result.read_text() == "the only copy"
    assert earlier.exists()
    assert main([*words, "--replace"]) == 0
    printed = capsys.readouterr()
    assert "pictures need matplotlib" in printed.err
    assert "pip install 'matplotlib" in printed.err
    assert f"companion run -c {os.path.relpath(ROOT / 'configs' / 'simulated.toml')}" in printed.out
    assert f"({os.path.relpath(ROOT / 'docs' / 'how-to' / 'import-recordings.md')})" in printed.out
    assert (tmp_path / "view" / "flight.html").stat().st_size > 10_000
    assert not list((tmp_path / "view").glob("*.png"))  # the earlier one neither: they would be of two flights
    assert sorted(p.name for p in tmp_path.iterdir()) == ["prisms.mcap", "view"]


def test_a_demo_keeps_the_log_of_one_that_is_running(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """It deleted DIR/demo-flight, in which the service of the other demo was recording."""
    recorded = tmp_path / "demo-flight" / "20260101-000000.000.mcap.active"
    recorded.parent.mkdir()
    recorded.write_text("being written")
    with sole_use(tmp_path):
        assert main(["demo", "--fast", "--seconds", "1", "-o", str(tmp_path)]) == 1
    err = capsys.readouterr().err
    assert f"{tmp_path}: another demo is running" in err
    assert "-o another directory" in err
    assert recorded.read_text() == "being written"
    with sole_use(tmp_path):
        pass  # it has ended


def test_causes_of_one_code_are_counted_by_their_texts() -> None:
    """All blind messages of a camera have one code: those before its first frame were printed with the cause of the last."""
    stats = ReceiveStats()
    for text in ("starting: no frame yet", "it is 0.4 s old", "it is 12.5 s old"):
        stats.add_invalid(pb.PrismsFrame(cause=pb.CAUSE_CAMERA, cause_text=text))
    assert stats.causes == {"camera": 3}
    assert stats.texts == {"starting: no frame yet": 1, "it is 0.4 s old": 2}


def test_the_embedded_default_is_the_shipped_file() -> None:
    assert load_config(ROOT / "configs" / "simulated.toml") == EMBEDDED


def test_the_configuration_is_flown_with_addresses_of_its_own(tmp_path: Path) -> None:
    nose = CameraConfig(name="nose", kind="simulated", flight="alley", width_px=320, pitch_deg=-9)
    config = Config(cameras=(nose, CameraConfig(name="real", kind="oak")), autopilot=AutopilotConfig(attitude_hz=55.0))
    flown = demo_config(config, DemoOptions(width_px=160))
    assert [(c.name, c.flight, c.width_px, c.fps) for c in flown.cameras] == [("nose", "alley", 160, MAX_FPS)]
    live = live_config(flown, tmp_path / "logs", tmp_path)
    assert live.autopilot.attitude_hz == 55.0
    assert live.autopilot.address != config.autopilot.address
    assert live.publish.prisms == f"ipc://{tmp_path}/prisms"
    assert config_of(tomllib.loads(toml_of(live)), "what the demo wrote") == live


def test_a_configuration_without_a_simulated_camera_is_refused() -> None:
    with pytest.raises(ValueError, match=r"configs/simulated\.toml"):
        demo_config(Config(cameras=(CAMERA.__class__(name="front", kind="oak"),)), DemoOptions())


@pytest.mark.parametrize("arguments", [["--seconds", "0"], ["--seconds", "many"], ["--seconds", "nan"]])
def test_wrong_use(arguments: list[str]) -> None:
    assert main(["demo", *arguments]) == 2


def test_a_flight_that_does_not_exist(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    config = tmp_path / "c.toml"
    config.write_text('[[camera]]\nname = "front"\nkind = "simulated"\nflight = "moon"\n')
    assert main(["demo", "-c", str(config), "-o", str(tmp_path / "out")]) == 1
    assert 'flight = "moon": expected one of "demo", "movers", "street"' in capsys.readouterr().err


# ---- its processes ----------------------------------------------------------------------------------------------------


@pytest.fixture
def processes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Processes:
    """Processes of small modules made here."""
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    (tmp_path / "fails.py").write_text('import sys\nsys.exit("no camera")\n')
    (tmp_path / "ignores_sigterm.py").write_text(
        "import signal\nsignal.signal(15, signal.SIG_IGN)\nprint('up', flush=True)\nsignal.pause()\n"
    )
    return Processes(tmp_path)


def test_a_process_that_ends_unexpectedly_is_reported_with_its_output(processes: Processes) -> None:
    processes.start("service", "fails")
    next(iter(processes._processes.values())).wait(60.0)
    with pytest.raises(DemoError, match="the service ended unexpectedly with status 1\nno camera"):
        processes.check()
    with pytest.raises(DemoError, match="the service ended with status 1\nno camera"):
        processes.end("service")


def test_a_process_that_does_not_end_is_killed_and_reported(
    processes: Processes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("companion.demo.live.END_S", 0.3)
    processes.start("service", "ignores_sigterm")
    process = next(iter(processes._processes.values()))
    while not (tmp_path / "service.out").read_text():
        assert process.poll() is None
    with pytest.raises(DemoError, match=r"did not end within 0\.3 s"):
        processes.end("service")
    assert process.wait(60.0) == -signal.SIGKILL


_KILLED_DEMO = """
import os, signal, sys, time
from pathlib import Path
from companion.demo.live import Processes
processes = Processes(Path(sys.argv[1]))
processes.start("service", "waits")
while not (Path(sys.argv[1]) / "service.out").read_text():
    time.sleep(0.02)
os.kill(os.getpid(), signal.SIGKILL)
"""


@pytest.mark.usefixtures("processes")
def test_the_processes_of_a_killed_demo_end(tmp_path: Path) -> None:
    """They went on, and the service recorded until the disk was full."""
    (tmp_path / "waits.py").write_text(
        "import os, signal\n"
        "signal.signal(signal.SIGTERM, lambda *_: open(os.environ['STATE_DIRECTORY'] + '/ended', 'w'))\n"
        "print(os.getpid(), flush=True)\nsignal.pause()\n"
    )
    killed = subprocess.run([sys.executable, "-c", _KILLED_DEMO, str(tmp_path)], check=False, cwd=ROOT)
    assert killed.returncode == -signal.SIGKILL
    assert until(lambda: (tmp_path / "ended").exists(), 60.0)


def test_the_way_to_the_commands_is_named_where_the_shell_does_not_find_them(monkeypatch: pytest.MonkeyPatch) -> None:
    """A newcomer types `make demo` and then what it prints."""
    scripts = Path(sysconfig.get_path("scripts"))
    monkeypatch.setenv("PATH", str(scripts))
    assert scripts_outside_path() is None
    monkeypatch.setenv("PATH", "/nowhere")
    assert scripts_outside_path() == scripts
