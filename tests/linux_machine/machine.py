"""A whole Linux machine with control groups of version 2, emulated: it runs a command among this computer's files.

Made once into `.cache/linux-machine/`: the kernel and the modules of Debian's own package, which is not installed, and
a first root of busybox and `init`. The computer's files are its own, read only; what a command writes is in memory
and gone afterwards. It computes 20 to 50 times slower than the computer and has no network.
"""

import compileall
import hashlib
import os
import shlex
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from tests.needs import CHECKOUT

CACHE = CHECKOUT / ".cache" / "linux-machine"
_INIT = Path(__file__).with_name("init")
_META_PACKAGE = "linux-image-amd64"  # names the newest kernel; the cloud's kernels have no 9p
_KERNEL = "console=ttyS0 quiet panic=-1 mitigations=off tsc=reliable clearcpuid=rep_good"
"""Faster when emulated: the clock is a register, not a device, and copies do not use `rep movs`, a step for each word.
Together with the processor, three imports of pytest used 17 s of this computer's time instead of 29 s."""
_MACHINE = (
    *("-accel", "tcg,thread=multi", "-cpu", "Nehalem", "-smp", "2", "-m", "2048"),
    *("-display", "none", "-vga", "none", "-net", "none", "-no-reboot", "-append", _KERNEL),
)
_PYTEST = ("-p", "no:cacheprovider", "-p", "no:xdist", "-p", "no:cov", "-p", "no:anyio", "-q", "--durations=0")


@dataclass(frozen=True, slots=True, kw_only=True)
class CommandResult:
    """How a command in the machine ended."""

    exit_code: int
    output: str  # standard output and standard error


class MachineFailed(Exception):
    """It was not made, did not start, or did not end in time; the message holds the end of its console."""


def run_in_machine(command: str, timeout_s: float, *, disk: Path | None = None) -> CommandResult:
    """Start the machine, run a command of its shell as root in the folder of the checkout, and wait for its end.

    Args:
        command: lines of a shell script.
        timeout_s: for all of it, the start of about 15 s included.
        disk: systemd is process 1, and the command a unit of its own. This archive's files, where it is there, lie on
            the disk from the start; what the command writes to `/run/job/disk.tar` is the archive of the next start.

    Returns:
        The command's exit code and output.

    Raises:
        MachineFailed: there is no result.
    """
    built = _built()
    with tempfile.TemporaryDirectory(prefix="rarms-machine-") as folder:
        job = Path(folder)
        (job / "command").write_text(f"cd '{CHECKOUT}' || exit 99\n{command}\n", encoding="utf-8")
        if disk is not None:
            (job / "systemd").touch()
            if disk.exists():
                shutil.copyfile(disk, job / "disk.tar")
        shares = (
            "local,path=/,mount_tag=root,security_model=none,readonly=on,multidevs=remap",
            f"local,path={job},mount_tag=job,security_model=none",
        )
        arguments = ["-kernel", str(built / "vmlinuz"), "-initrd", str(built / "initramfs")]
        arguments += ["-serial", f"file:{job / 'console'}", "-virtfs", shares[0], "-virtfs", shares[1]]
        try:
            subprocess.run(
                ["qemu-system-x86_64", *_MACHINE, *arguments],
                stdin=subprocess.DEVNULL,
                capture_output=True,
                timeout=timeout_s,
                check=True,
            )
            code = int((job / "exit_code").read_text(encoding="ascii"))
        except (OSError, ValueError, subprocess.SubprocessError) as problem:
            raise MachineFailed(f"{problem}\n{_end_of(job / 'console')}\n{_end_of(job / 'output')}") from problem
        if disk is not None and (job / "disk.tar").exists():
            shutil.copyfile(job / "disk.tar", disk)
        return CommandResult(exit_code=code, output=(job / "output").read_text(encoding="utf-8", errors="replace"))


def run_tests_in_machine(
    tests: Sequence[str], timeout_s: float, *, before: str = "", disk: Path | None = None
) -> CommandResult:
    """Run tests of this checkout in the machine, with one process of pytest: each start takes 20 s there.

    Args:
        tests: files, tests and further options of pytest.
        timeout_s: as for `run_in_machine`, without the time to compile on this computer.
        before: lines of a shell script that run first.
        disk: as for `run_in_machine`.

    Raises:
        MachineFailed: there is no result.
    """
    _compile(tests)
    words = (".venv/bin/python", "-m", "pytest", *_PYTEST, "--basetemp=/tmp/pytest-in-machine", *tests)
    result = run_in_machine(f"{before}{shlex.join(words)}", timeout_s, disk=disk)
    sys.stdout.write(result.output)  # `pytest -rP` shows how long each test took
    return result


def _compile(tests: Sequence[str]) -> None:
    """Compile the program and, as pytest changes them, the tests: the machine would do it in each run, in a minute."""
    compileall.compile_dir(CHECKOUT / "rarms_iac", quiet=1)
    may_write = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    words = [sys.executable, "-m", "pytest", "--collect-only", *_PYTEST, *tests]
    collected = subprocess.run(words, cwd=CHECKOUT, env=may_write, capture_output=True, text=True, check=False)
    if collected.returncode:
        raise MachineFailed(f"pytest cannot collect {shlex.join(tests)}\n{collected.stdout}\n{collected.stderr}")


def _end_of(file: Path) -> str:
    return file.read_text(encoding="utf-8", errors="replace")[-3000:] if file.is_file() else f"no {file.name}"


def _built() -> Path:
    """The folder with kernel and first root, made where it is not there for this kernel and this `init`."""
    words = _output_of("apt-cache", "depends", _META_PACKAGE).split()
    package = words[words.index("Depends:") + 1] if "Depends:" in words else _META_PACKAGE
    content = package.encode() + _INIT.read_bytes()
    target = CACHE / hashlib.sha256(content).hexdigest()[:12]
    if target.is_dir():
        return target
    CACHE.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=CACHE) as folder:
        made = Path(folder) / "made"
        _build(Path(folder), made, package)
        if not target.is_dir():  # another test run may have been quicker
            made.rename(target)
    return target


def _build(folder: Path, made: Path, package: str) -> None:
    _output_of("apt-get", "download", "--quiet", package, folder=folder)
    (archive,) = folder.glob("*.deb")
    _output_of("dpkg-deb", "--extract", str(archive), str(folder / "kernel"))
    root = folder / "root"
    for name in ("bin", "modules"):
        (root / name).mkdir(parents=True)
    shutil.copy2(_INIT, root / "init")
    (root / "init").chmod(0o755)
    busybox = shutil.which("busybox")
    assert busybox is not None, "the need linux-machine was met"
    shutil.copy2(busybox, root / "bin" / "busybox")
    for module in (folder / "kernel").rglob("*.ko"):
        if module.stem in _INIT.read_text(encoding="utf-8").replace("\\\n", "").split():
            shutil.copy2(module, root / "modules")
    made.mkdir()
    (kernel,) = (folder / "kernel" / "boot").glob("vmlinuz-*")
    shutil.copy2(kernel, made / "vmlinuz")
    names = "\n".join(path.relative_to(root).as_posix() for path in sorted(root.rglob("*"))).encode()
    with (made / "initramfs").open("wb") as packed:
        subprocess.run(["cpio", "-o", "-H", "newc", "--quiet"], cwd=root, input=names, stdout=packed, check=True)


def _output_of(*words: str, folder: Path = CHECKOUT) -> str:
    try:
        return subprocess.run(words, cwd=folder, capture_output=True, check=True, text=True, timeout=300).stdout
    except (OSError, subprocess.SubprocessError) as problem:
        error = problem.stderr if isinstance(problem, subprocess.CalledProcessError) else ""
        raise MachineFailed(f"{problem} {error}".strip()) from problem
