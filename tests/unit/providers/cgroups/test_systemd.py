"""What systemctl is asked for where systemd is process 1, answered by a systemctl that does it in a plain folder."""

import os
import shutil
from pathlib import Path

import pytest

from rarms_iac.model.operations import CreatePartition, RemovePartition, StartPartition, set_to
from rarms_iac.model.plan import Scope
from rarms_iac.model.state import RunState, StartAction
from rarms_iac.providers.cgroups import effects, provider, trees
from rarms_iac.providers.cgroups.effects import LinuxEffects
from rarms_iac.providers.cgroups.groups import GroupValues
from rarms_iac.providers.cgroups.machine import read_boot
from rarms_iac.providers.cgroups.provider import LinuxHostProvider
from rarms_iac.providers.cgroups.trees import SYSTEMD_FOLDER, GroupTreeSystemd, MissingFeatures, find_tree
from rarms_iac.providers.interface import HostRefused
from tests import builders
from tests.contracts.benches import on_linux

pytestmark = pytest.mark.needs("linux")

MIB = 2**20
VISION = "rarms-face_detection.slice"
SCOPE = Scope(application="robot", plan="0123abcd")
SYSTEMCTL = """\
#!/bin/sh
# Does with folders what systemd does with control groups, and notes what it was asked for.
cd '{folder}' || exit 1
echo "$*" >>asked
command=$1 unit=$2
case $command in
start)
    mkdir -p "kernel/rarms.slice/$unit"
    for group in kernel/rarms.slice "kernel/rarms.slice/$unit"; do
        [ -e "$group/cpu.max" ] || echo 'max 100000' >"$group/cpu.max"
        [ -e "$group/cpu.weight" ] || echo 100 >"$group/cpu.weight"
        [ -e "$group/memory.max" ] || echo max >"$group/memory.max"
        : >"$group/memory.stat"
        : >"$group/cgroup.procs"
    done
    ;;
set-property)
    case $unit in rarms.slice) group=kernel/$unit ;; *) group=kernel/rarms.slice/$unit ;; esac
    shift 2
    for property; do
        value=${{property#*=}}
        case $property in
        CPUWeight=*) echo "$value" >"$group/cpu.weight" ;;
        CPUQuota=) quota='' ;;
        CPUQuota=*) quota=${{value%.*}} ;;
        CPUQuotaPeriodSec=*) period=${{value%us}} && echo "${{quota:+$((quota * period / 100))}} $period" |
            sed 's/^ /max /' >"$group/cpu.max" ;;
        MemoryMax=*) echo "$value" | sed s/infinity/max/ >"$group/memory.max" ;;
        esac
    done
    ;;
stop) rm -rf "kernel/rarms.slice/$unit" "kernel/$unit" ;;
add-wants) touch "units/wants-$5" ;;
disable) rm -f "units/wants-$4" ;;
esac
"""


class Lab:
    """A folder with the kernel's files and systemd's units."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        (folder / "units").mkdir()
        (folder / "kernel").mkdir()
        (folder / "kernel" / "cpuset.cpus.effective").write_text("0-1\n")
        slices = dict.fromkeys(("cpu", "cpuacct", "cpuset", "memory"), folder / "kernel" / "rarms.slice")
        self.tree = GroupTreeSystemd(LinuxEffects(), slices)

    def asked(self) -> list[str]:
        """What systemctl was asked for since the last call."""
        text = (self.folder / "asked").read_text()
        (self.folder / "asked").unlink()
        return text.splitlines()

    def units(self) -> list[str]:
        return sorted(path.name for path in (self.folder / "units").iterdir())

    def host(self) -> LinuxHostProvider:
        return LinuxHostProvider(on_linux(builders.a_host()), self.folder / "state", self.tree)

    def restart_machine(self) -> None:
        """What the kernel had is gone, and systemd starts the units that the machine wants."""
        for name in self.tree.names():
            if f"wants-{name}" not in self.units():
                shutil.rmtree(self.folder / "kernel" / "rarms.slice" / name)


@pytest.fixture
def lab(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Lab:
    (tmp_path / "systemctl").write_text(SYSTEMCTL.format(folder=tmp_path))
    (tmp_path / "systemctl").chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:{os.environ['PATH']}")
    monkeypatch.setattr(trees, "UNITS", tmp_path / "units")
    return Lab(tmp_path)


def test_a_partition_is_a_unit_with_properties(lab: Lab) -> None:
    name = lab.tree.name_for("face-detection")
    values = GroupValues(shares_percent=80, quota_percent=33, period_us=7_777, memory=64 * MIB)

    lab.tree.make(name)
    assert (name, lab.units()) == (VISION, [VISION])
    assert lab.asked() == [f"start {VISION}", "set-property rarms.slice CPUWeight=10000"]

    lab.tree.write(name, values)
    assert lab.asked() == [
        f"set-property {VISION} CPUWeight=80 CPUQuota=33.00% CPUQuotaPeriodSec=7777us MemoryMax=67108864 AllowedCPUs="
    ]
    assert lab.tree.read(name) == lab.tree.as_kernel_shows(values)
    assert lab.tree.read(name).quota_percent == 2566 * 100 / 7777  # systemd rounds down

    lab.tree.limit_slice(180)
    assert lab.asked() == ["set-property rarms.slice CPUQuota=180.00% CPUQuotaPeriodSec=20000us"]
    assert lab.tree.read("").quota_percent == 180
    assert lab.tree.place(name).words[-2:] == (f"--slice={VISION}", "--")
    assert lab.tree.place(name).join == ()


def test_slice_goes_with_its_last_unit(lab: Lab) -> None:
    lab.tree.make(VISION)
    lab.tree.start_with_machine(VISION, True)
    assert lab.units() == [VISION, f"wants-{VISION}"]
    lab.asked()

    lab.tree.remove(VISION)

    stopped, slice_stopped = (f"stop {VISION}", f"revert {VISION}"), ["stop rarms.slice", "revert rarms.slice"]
    assert lab.asked() == [stopped[0], f"disable --no-reload --quiet {VISION}", stopped[1], *slice_stopped]
    assert (lab.tree.names(), lab.units()) == ((), [])


def test_systemds_refusal_is_said_in_its_words(lab: Lab) -> None:
    (lab.folder / "systemctl").write_text("#!/bin/sh\necho 'Access denied' >&2\nexit 4\n")

    with pytest.raises(OSError, match=f"systemctl start {VISION}: Access denied"):
        lab.tree.make(VISION)


def test_late_controller_is_waited_for(lab: Lab, monkeypatch: pytest.MonkeyPatch) -> None:
    lab.tree.make(VISION)
    read, looks = LinuxEffects.read, [FileNotFoundError(), FileNotFoundError()]

    def read_later(effects: LinuxEffects, path: Path) -> str:
        if looks and path.name == "cpu.weight":
            raise looks.pop()
        return read(effects, path)

    monkeypatch.setattr(LinuxEffects, "read", read_later)

    lab.tree.write(VISION, GroupValues(shares_percent=80))

    assert looks == []


def test_systemctl_that_does_not_end_is_given_up(lab: Lab, monkeypatch: pytest.MonkeyPatch) -> None:
    (lab.folder / "systemctl").write_text("#!/bin/sh\nexec sleep 60\n")
    monkeypatch.setattr(effects, "_RUN_SECONDS", 0.1)

    with pytest.raises(TimeoutError, match=f"start.*{VISION}"):
        lab.tree.make(VISION)


def test_half_read_machine_is_read_again(lab: Lab, monkeypatch: pytest.MonkeyPatch) -> None:
    host = LinuxHostProvider(on_linux(builders.a_host()), lab.folder / "state")
    found = iter([MissingFeatures(names=("cpu",)), lab.tree])
    monkeypatch.setattr(provider, "find_tree", lambda *_: next(found))
    with pytest.raises(HostRefused):
        host.boot  # noqa: B018 - reading it is what fails

    assert host.boot == "systemd"


def test_systemd_uses_version_2_unless_asked(
    tmp_path: Path,
) -> None:
    root = tmp_path / "sys" / "fs" / "cgroup"
    for folder in (root, tmp_path / SYSTEMD_FOLDER):
        folder.mkdir(parents=True)
    (root / "cgroup.controllers").write_text("cpuset cpu io memory pids\n")

    assert isinstance(find_tree("rarms", root=root), GroupTreeSystemd)
    (root / "cgroup.controllers").unlink()
    missing = find_tree("rarms", root=root)
    assert isinstance(missing, MissingFeatures)
    assert "version 2 of control groups" in missing.names[0]
    forced = find_tree("rarms", "v1", root=root)
    assert isinstance(forced, MissingFeatures)
    assert "of version 1" in forced.names[0]


def test_restart_keeps_partitions_except_manual_ones(lab: Lab) -> None:
    host = lab.host()
    for name in ("vision", "speech"):
        host.execute(CreatePartition(partition=name, generation=2, memory=64 * MIB), SCOPE)
        host.execute(set_to(name, reserve=20, limit=50, weight=100), SCOPE)
    host.execute(set_to("vision", start_action=StartAction.START), SCOPE)
    for name in ("vision", "speech"):
        host.execute(StartPartition(partition=name), SCOPE)
    before = host.observe()
    assert all(partition.settings.running for partition in before.partitions)

    lab.restart_machine()

    after = {found.settings.start_action: found for found in lab.host().observe().partitions}
    assert read_boot(LinuxEffects()) != lab.host().boot == "systemd"
    assert after[StartAction.START] in before.partitions
    assert after[StartAction.NOTHING].state is RunState.OFF
    host.execute(RemovePartition(partition="speech"), SCOPE)
    assert len(lab.units()) == 2
