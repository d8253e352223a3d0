"""A throw-away machine with a real systemd: qemu without KVM, Debian's kernel, this machine's own root, read-only.

The machine's root is the host's over 9p with an overlay in memory; nothing of the host can be changed. The software is
installed for it from a wheel into a folder of its own, kernels compiled for a plain processor, since the emulated one is
not the host's. A script runs in it and prints its findings behind a mark on the serial console."""

from __future__ import annotations

import contextlib
import gzip
import json
import os
import shutil
import subprocess
import sys
import sysconfig
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

CHECKOUT = Path(__file__).resolve().parents[2]
KERNEL_ENV = "VM_KERNEL"
"""Folder of an unpacked kernel package (boot/, lib/modules/); `make vm-test` fetches one and sets this."""
HOME = Path("opt/osape-companion")
MARK = "@@RESULT "
NEEDED_TOOLS = ("qemu-system-x86_64", "busybox", "cpio", "depmod", "systemctl", "udevadm", "dbus-daemon")
BOOT_MODULES = ("virtio_pci", "9pnet_virtio", "9p", "overlay")
DEVICE_MODULES = ("vivid",)
PLAIN_PROCESSOR = {"NUMBA_CPU_NAME": "generic", "NUMBA_CPU_FEATURES": ""}
MASKED = (
    "systemd-tmpfiles-setup.service",
    "systemd-tmpfiles-setup-dev.service",
    "systemd-binfmt.service",
    "proc-sys-fs-binfmt_misc.automount",
    "systemd-update-utmp.service",
    "tmp.mount",
    "e2scrub_reap.service",
    "postgresql.service",
    "systemd-timesyncd.service",
)
"""Slow over 9p, or of no use."""

INIT = """#!/bin/busybox sh
/bin/busybox --install -s /bin
mkdir -p /proc /sys /dev /low /up /newroot
mount -t proc proc /proc; mount -t sysfs sys /sys; mount -t devtmpfs dev /dev
for module in {boot}; do insmod /modules/$module || echo "insmod $module failed"; done
mount -t 9p -o trans=virtio,version=9p2000.L,ro,msize=524288,cache=loose hostfs /low || poweroff -f
mount -t tmpfs tmpfs /up; mkdir -p /up/upper /up/work
mount -t overlay -o lowerdir=/low,upperdir=/up/upper,workdir=/up/work overlay /newroot || poweroff -f
mkdir -p /newroot/{home} /newroot/opt/deps /newroot/opt/python /newroot/opt/modules
mount --bind /newroot{stage}/{home} /newroot/{home}
mount --bind /newroot{deps} /newroot/opt/deps
mount --bind /newroot{python} /newroot/opt/python
cp /modules/* /newroot/opt/modules/; cp {units} /newroot/etc/systemd/system/
cp /vm_checks.py /newroot/opt/vm_checks.py
: > /newroot/etc/fstab
for unit in {masked}; do ln -sf /dev/null /newroot/etc/systemd/system/$unit; done
umount /proc; umount /sys; mount --move /dev /newroot/dev 2>/dev/null
exec switch_root /newroot /lib/systemd/systemd --unit=vmtest.target
"""
TARGET = """[Unit]
Description=What is tested
Requires=basic.target vmtest.service
After=basic.target
AllowIsolate=yes
"""
CHECKS = """[Unit]
Description=The checks
After=basic.target systemd-udevd.service
[Service]
Type=oneshot
ExecStart=/{home}/bin/python3 /opt/vm_checks.py
StandardOutput=journal
TimeoutStartSec=infinity
SuccessAction=poweroff-immediate
FailureAction=poweroff-immediate
"""


@dataclass(frozen=True, slots=True)
class Machine:
    """What is needed to start one: the kernel's image, and the folder with the staged software and the initramfs."""

    kernel: Path
    folder: Path


def prepare(folder: Path, checks: Path) -> Machine:
    """A machine that runs the script `checks`. Skips the test, with a word, where a part is absent."""
    missing = [tool for tool in NEEDED_TOOLS if shutil.which(tool) is None]
    if missing:
        pytest.skip(f"no virtual machine: {', '.join(missing)} not installed; `make vm-test` names the packages")
    unpacked = os.environ.get(KERNEL_ENV, "")
    kernels = sorted(Path(unpacked).glob("boot/vmlinuz-*")) if unpacked else []
    if not kernels:
        pytest.skip("no kernel for a virtual machine: `make vm-test` fetches one")
    kernel = kernels[-1]
    modules = Path(unpacked) / "lib" / "modules" / kernel.name.removeprefix("vmlinuz-")
    stage = folder / "stage"
    install_software(stage)
    write_initramfs(folder, stage, modules, checks)
    return Machine(kernel, folder)


def install_software(stage: Path) -> None:
    """Installs the checkout as `pip install` would, with an interpreter where the service can see it, and compiles the
    kernels: all at the paths that they have in the machine."""
    home = stage / HOME
    shutil.rmtree(home, ignore_errors=True)
    source = stage / "source"
    shutil.rmtree(source, ignore_errors=True)
    for part in ("core", "drivers", "companion", "clients/python", "systemd", "configs", "docs"):
        shutil.copytree(CHECKOUT / part, source / part, ignore=shutil.ignore_patterns("__pycache__", "pictures"))
    for name in ("pyproject.toml", "README.md", "LICENSE", "NOTICE"):
        shutil.copy2(CHECKOUT / name, source / name)
    pip = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--no-build-isolation", "--ignore-installed"]
    subprocess.run([*pip, "--prefix", str(home), str(source / "clients/python"), str(source)], check=True, cwd=stage)
    site = home / "lib" / f"python{sysconfig.get_python_version()}" / "site-packages"
    (site / "vm.pth").write_text(
        "/opt/deps\n" + f"import os; os.environ.update({PLAIN_PROCESSOR!r})\n"  # a .pth may run one line
    )
    interpreter = Path("/opt/python/bin") / Path(sys.executable).resolve().name
    (home / "bin" / "python3").symlink_to(interpreter)
    (home / "pyvenv.cfg").write_text(f"home = {interpreter.parent}\ninclude-system-site-packages = false\n")
    command = home / "bin" / "companion"
    command.write_text(f"#!/{HOME}/bin/python3\n" + command.read_text().split("\n", 1)[1])
    compile_kernels(home, site)
    subprocess.run(["chmod", "-R", "a+rX", str(stage)], check=True)


def compile_kernels(home: Path, site: Path) -> None:
    """For a plain processor, on the host, where the installation finds them (companion/kernels/jit_cache.py)."""
    made = home / "share" / "osape-companion" / "kernels"
    paths = os.pathsep.join([str(site), sysconfig.get_path("purelib")])
    environment = {**os.environ, **PLAIN_PROCESSOR, "NUMBA_CACHE_DIR": str(made), "PYTHONPATH": paths}
    warm = "import sys; from companion.cli import main; sys.exit(main(['warmup']))"
    subprocess.run([sys.executable, "-c", warm], env=environment, check=True, cwd=home, stdout=subprocess.DEVNULL)


def write_initramfs(folder: Path, stage: Path, modules: Path, checks: Path) -> None:
    """busybox, modules in the order of their needs, our units, and the script that changes over to the real root."""
    tree = folder / "initramfs"
    shutil.rmtree(tree, ignore_errors=True)
    for sub in ("bin", "modules", "units"):
        (tree / sub).mkdir(parents=True)
    shutil.copy2(shutil.which("busybox") or "", tree / "bin" / "busybox")
    boot = in_order(modules, BOOT_MODULES)
    for module in {*boot, *in_order(modules, DEVICE_MODULES)}:
        shutil.copy2(modules / module, tree / "modules" / Path(module).name)
    device = [Path(m).name for m in in_order(modules, DEVICE_MODULES) if m not in boot]
    (tree / "modules" / "device-order").write_text("\n".join(device))
    (tree / "units" / "vmtest.target").write_text(TARGET)
    (tree / "units" / "vmtest.service").write_text(CHECKS.format(home=HOME))
    shutil.copy2(checks, tree / "vm_checks.py")
    init = INIT.format(
        boot=" ".join(Path(m).name for m in boot),
        home=HOME,
        stage=stage,
        deps=sysconfig.get_path("purelib"),
        python=sys.base_prefix,
        units="/units/*",
        masked=" ".join(MASKED),
    )
    (tree / "init").write_text(init)
    (tree / "init").chmod(0o755)
    names = "\n".join(str(p.relative_to(tree)) for p in sorted(tree.rglob("*")))
    packed = subprocess.run(
        ["cpio", "--quiet", "-o", "-H", "newc"], input=names.encode(), cwd=tree, stdout=subprocess.PIPE, check=True
    ).stdout
    (folder / "initramfs.gz").write_bytes(gzip.compress(packed, 1))


def in_order(modules: Path, wanted: tuple[str, ...]) -> list[str]:
    """Files of modules below their folder, each after those that it needs."""
    if not (modules / "modules.dep").exists():
        base = modules.parents[2]
        subprocess.run(["depmod", "-b", str(base), modules.name], check=True)
    needs: dict[str, list[str]] = {}
    for line in (modules / "modules.dep").read_text().splitlines():
        file, _, others = line.partition(":")
        needs[file] = others.split()
    order: list[str] = []
    for name in wanted:
        file = next(f for f in needs if Path(f).name == f"{name}.ko")
        order += [f for f in [*reversed(needs[file]), file] if f not in order]
    return order


def run_machine(machine: Machine, timeout_s: float) -> tuple[dict[str, Any], str]:
    """Runs it to its end; the results of the script, and the whole console output."""
    command = [
        "qemu-system-x86_64", "-accel", "tcg,thread=multi", "-cpu", "max", "-smp", "2", "-m", "3000", "-nographic",
        "-no-reboot", "-kernel", str(machine.kernel), "-initrd", str(machine.folder / "initramfs.gz"),
        "-virtfs", "local,path=/,mount_tag=hostfs,security_model=none,readonly=on,multidevs=remap",
        "-append", "console=ttyS0 panic=-1 quiet systemd.show_status=no", "-nic", "none",
    ]  # fmt: skip
    with (machine.folder / "console.txt").open("wb") as file, contextlib.suppress(subprocess.TimeoutExpired):
        subprocess.run(
            command, stdin=subprocess.DEVNULL, stdout=file, stderr=subprocess.STDOUT, timeout=timeout_s, check=False
        )
    console = (machine.folder / "console.txt").read_text(errors="replace")
    found: dict[str, Any] = {}
    for line in console.splitlines():
        if MARK in line:
            found |= json.loads(line.split(MARK, 1)[1])
    return found, console
