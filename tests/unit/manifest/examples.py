"""One manifest that says everything a manifest can say, and a check that finds nothing."""

from datetime import date

from rarms_iac.model.diagnostics import Diagnostic, Places
from rarms_iac.model.system import System

EVERYTHING = """\
schema: rarms/v1
application: { name: cell-7, description: Says everything., requires_rarms: ">=0.1" }
hosts:
  onboard:
    provider: simulated
    platform: atom
    logical_processors: 4
    memory: 8 GiB
    keep_for_host: { processor: 0.5 LP, memory: 1 GiB }
    system_responsiveness: 30
    simulated:
      windows_build: 20348
      guest_windows_build: 19045
      client: false
      scheduler: core
      smt: true
      administrator: true
      faults:
        no-start: { operation: start_partition, at: partition/vision, effect: refuse, delay: 2 s, times: 1 }
  server:
    provider: hyperv
    logical_processors: 8
    memory: 64 GiB
    connect:
      { ssh: operator@server, shell: powershell, port: 2222, key: ~/.ssh/cell, jump: gate, control_path: ~/.ssh/%C }
    hyperv: { switch: robots, image: 'D:\\images\\base.vhdx', vm_path: 'D:\\machines', generation: 2, secure_boot: off }
  far:
    provider: hyperv
    logical_processors: 8
    memory: 64 GiB
    connect: { winrm: far.plant.example, receiver: installed, user: 'PLANT\\rarms', port: 5986,
      password: { from_env: FAR_PASSWORD } }
  bench:
    provider: linux
    logical_processors: 2
    memory: 4 GiB
    linux: { slice: rarms, control_groups: v2, mechanism: quota }
components:
  vision:
    criticality: 40
    apt:
      mean_response_time: { at_most: 100 ms }
      p99.9_response_time: { at_most: 1 s }
      jitter: { at_most: 10 ms }
      success_rate: { at_least: 95 % }
      throughput: { at_least: 24 /s }
      deadline_miss_rate: { at_most: 1 % }
    run:
      command: [python3, components/vision.py, --fast]
      files: ['components/models/*.bin']
      environment: { LEVEL: '3', TOKEN: { from_env: VISION_TOKEN } }
      folder: work
      until: { samples: 200 }
      timeout: 30 s
      stop: { signal: INT, grace: 2 s }
      arrival: { every: 33 ms }
      samples:
        from: pattern
        stream: stdout
        pattern: '^ok=(?P<ok>[01]) ms=(?P<ms>[0-9.]+) n=(?P<n>[0-9]+)'
        response_time: { field: ms, unit: ms }
        success: { field: ok }
        count: { field: n }
      deadline: 40 ms
      failures: 2
    memory: 512 MiB
    processors: 2
    cpu: { reserve: 1.4 LP, limit: 80 %, weight: 200, starting: { reserve: 1.5 LP, for: 30 s } }
    together: [speech]
    apart: [planning]
    dedicated: false
    new: false
    task: { class: ObjectIdentification, threads: ["detect*"] }
    hosts: [onboard, server]
    runs_on: partition
    interference: browsers
    simulation: { work: 61.6 ms, blocked: 26.4 ms, varies: 5 %, threads: 2, success_within: 90 ms }
  speech:
    criticality: 30
    apt: { maximum_response_time: { at_most: 400 ms }, minimum_response_time: { at_most: 300 ms } }
    run: { call: 'components.speech:listen', arrival: closed, until: { elapsed: 60 s } }
    cpu: { reserve: measured }
  planning:
    criticality: 20
    runs_on: host
    run: { command: [plan], timeout: 1 s, samples: { from: ros, input: /map, output: /plan/way } }
  faces:
    criticality: 10
    run:
      processes:
        camera:
          service:
            exec: [camera, --fast]
            properties:
              Environment: [LEVEL=3]
              WorkingDirectory: /opt/robot
              SupplementaryGroups: video
              LimitMEMLOCK: 64M
              Nice: -5
              CPUSchedulingPolicy: fifo
              CPUSchedulingPriority: 20
        detector:
          container: { engine: podman, image: faces, command: [detect], options: [--device=/dev/video0] }
          user: robot
      environment: { from_file: robot.env }
      user: root
      groups: [video]
      samples: { from: json_lines, process: detector, file: out/faces.jsonl }
  planner:
    criticality: 5
    run:
      service: { exec: [plan], properties: { Restart: on-failure } }
      setup: [install/setup.bash]
      samples: { from: json_lines, socket: planner.sock }
  route:
    criticality: 4
    run: { attach: { container: nav2, engine: docker }, samples: { from: json_lines } }
  map:
    criticality: 3
    run: { attach: { service: slam }, samples: { from: json_lines } }
partitions:
  senses:
    components: [vision, speech]
    processors: 2
    memory: 2 GiB
    cpu: { reserve: 60 %, weight: 100 }
    protect: true
    start: manual
    stop: { grace: 90 s }
    hyperv: { generation: 1, switch: other, image: x.vhd, vm_path: y, clustered: true }
    guest: { connect: { ssh: robot@senses }, credential: senses-admin }
interference:
  busy: { kind: busy_loop, threads: 2 }
  pulses: { kind: bursts, every: 40 ms, duty: 30 %, threads: 2 }
  frames: { kind: bursts, every: 33 ms }
  browsers: { kind: browser, instances: 5 }
  disk: { kind: command, command: [fio, disk.fio], instances: 2 }
  memory: { kind: stress, stressor: stream, workers: 2 }
tasks:
  ObjectIdentification: { category: Medium, priority: 6 }
  Pro Audio: { category: Low, background_priority: 3, replace_shipped: true }
policy:
  interference: busy
  minimise: reservation
  headroom: equal
  max_disruption: partition_stop
  unused: keep
  signed_plans: true
  measuring: { setting: 5 min, proof: 1 h, slow_job: 10, precision: 5 % }
  accept:
    RARMS041: { at: [partition/senses], reason: Known., until: '2027-01-31' }
moved: { ears: senses }
"""


def no_checks(_system: System, _places: Places, _today: date) -> tuple[Diagnostic, ...]:
    return ()
