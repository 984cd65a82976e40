"""What tests of measuring on Hyper-V begin from."""

from tests.fake_powershell.cells import a_windows
from tests.fake_powershell.host import Program, WindowsHost

MANIFEST = r"""
schema: rarms/v1
application: { name: robot }
policy: { interference: busy-loop }
hosts:
  cell:
    provider: hyperv
    logical_processors: 4
    memory: 8 GiB
    hyperv: { image: 'D:\images\robot''s.vhdx', vm_path: 'D:\vms', credential: robot/guests }
components:
  vision:
    criticality: 5
    memory: 1 GiB
    processors: 1
    apt: { mean_response_time: { at_most: 100 ms } }
    run: { command: [vision.exe, --once], until: { samples: 60 } }
"""
CREDENTIAL = "C:\\ProgramData\\rarms\\credentials\\robot_guests.txt"


def a_measurable_windows(**programs: Program) -> WindowsHost:
    """A server that keeps what its guests are entered with; a job of `vision.exe` takes 20 ms of processor time."""
    host = a_windows()
    host.write_file(CREDENTIAL, f"{host.guest_user}\r\n{host.guest_secret}\r\n".encode("ascii"))
    host.programs = {"vision.exe": Program(work_ms=20), "powershell.exe": Program()}
    host.programs |= {f"{name}.exe": program for name, program in programs.items()}
    return host
