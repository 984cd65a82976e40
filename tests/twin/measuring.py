"""What tests of measuring on Hyper-V begin from."""

MANIFEST = r"""
schema: rarms/v1
application: { name: robot }
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
    processors: 2
    apt: { mean_response_time: { at_most: 100 ms } }
    run: { command: [vision.exe, --once], until: { samples: 60 } }
"""
