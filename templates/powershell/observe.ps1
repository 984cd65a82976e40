#Requires -Version 5.1
# rarms observe script: prints what this host looks like as one JSON document, and changes nothing.
# It runs without elevation; every probe says whether its value was read, is absent, or was denied.
[CmdletBinding()]
param()

# What a profile or a caller set must reach none of the calls below.
$PSDefaultParameterValues = @{}
$ErrorActionPreference = 'Stop'
$WarningPreference = 'SilentlyContinue'
$VerbosePreference = 'SilentlyContinue'
$DebugPreference = 'SilentlyContinue'
$InformationPreference = 'SilentlyContinue'
$ProgressPreference = 'SilentlyContinue'
$ConfirmPreference = 'None'
$WhatIfPreference = $false
$PSModuleAutoLoadingPreference = 'All'
Set-StrictMode -Version 3.0

$mode = [string] $ExecutionContext.SessionState.LanguageMode
if ($mode -cne 'FullLanguage') {
    throw ('PowerShell runs in {0} here, by AppLocker or App Control: scripts of rarms need FullLanguage' -f $mode)
}

function ConvertTo-AsciiJson {
    # One line of JSON in pure ASCII; 5.1 and 7 leave different characters as they are.
    param($Value)
    $text = ConvertTo-Json -InputObject $Value -Depth 20 -Compress
    [regex]::Replace($text, '[^\x20-\x7e]', { '\u{0:x4}' -f [int] [char] $args[0].Value })
}

function Get-Probe {
    # A value with the word that it was read, or why there is none. -Many: always an array.
    param([scriptblock] $Read, [switch] $Many)
    try {
        if ($Many) { return [ordered] @{ status = 'value'; value = @(& $Read) } }
        [ordered] @{ status = 'value'; value = & $Read }
    } catch {
        $id = [string] $_.FullyQualifiedErrorId
        $category = [string] $_.CategoryInfo.Category
        $denied = @('PermissionDenied', 'SecurityError') -ccontains $category
        $denied = $denied -or $id -clike 'AccessDenied*' -or $id -clike '*UnauthorizedAccess*' -or $id -clike '*0x80041003*'
        $status = if ($denied) { 'denied' } else { 'absent' }
        [ordered] @{ status = $status; error = $id; message = [string] $_.Exception.Message }
    }
}

function Get-Setting {
    # A property that older hosts lack, as text; nothing where it is missing.
    param($Of, [string] $Name)
    $found = $Of.PSObject.Properties[$Name]
    if ($null -ne $found) { [string] $found.Value }
}

function Get-HostIdentity {
    # What tells this Windows from every other. Not its own id, of which other programs make what they know it by.
    $key = Microsoft.PowerShell.Management\Get-Item -LiteralPath 'HKLM:\SOFTWARE\Microsoft\Cryptography'
    $id = [string] $key.GetValue('MachineGuid')
    if (-not $id.Trim()) { return '' }
    $data = [System.Text.Encoding]::ASCII.GetBytes('rarms host ' + $id.Trim().ToLowerInvariant())
    $sum = [System.Security.Cryptography.SHA256]::Create().ComputeHash($data, 0, $data.Length)
    ([System.BitConverter]::ToString($sum) -replace '-', '').ToLowerInvariant().Substring(0, 32)
}

function Get-MachineList {
    # All machines, listed once for all that is read of them.
    if ($null -eq $script:Machines) { $script:Machines = @(Hyper-V\Get-VM) }
    $script:Machines
}

function Get-MachineId {
    param($Vm)
    ([string] $Vm.Id).ToLowerInvariant()
}

function Get-Answer {
    # What a cmdlet says of machines, by their ids: of all at once; where one makes it fail, of one after another.
    param([scriptblock] $Read, $Machines)
    $answers = @{}
    $script:Asked = @($Machines)
    if (-not $script:Asked.Count) { return $answers }
    $all = Get-Probe -Many -Read $Read
    foreach ($vm in @($Machines)) {
        $script:Asked = @($vm)
        $answers[(Get-MachineId -Vm $vm)] = if ($all['status'] -ceq 'value') {
            [ordered] @{ status = 'value'; value = @() }
        } else {
            Get-Probe -Many -Read $Read
        }
    }
    foreach ($one in @(if ($all['status'] -ceq 'value') { $all['value'] })) {
        $answer = $answers[([string] $one.VMId).ToLowerInvariant()]
        $answer['value'] = @($answer['value']) + $one
    }
    $answers
}

function Get-AnswerList {
    # What all machines were asked, once: by kind, then by their ids.
    if ($null -eq $script:Answers) {
        $vms = @(Get-MachineList)
        $script:Answers = [ordered] @{
            cpu = Get-Answer -Machines $vms -Read { Hyper-V\Get-VMProcessor -VM $script:Asked }
            memory = Get-Answer -Machines $vms -Read { Hyper-V\Get-VMMemory -VM $script:Asked }
            disks = Get-Answer -Machines $vms -Read { Hyper-V\Get-VMHardDiskDrive -VM $script:Asked }
            checkpoints = Get-Answer -Machines $vms -Read { Hyper-V\Get-VMSnapshot -VM $script:Asked }
        }
    }
    $script:Answers
}

function Get-MachineReading {
    # A machine with its settings, or why one of them could not be read.
    param($Vm)
    $of = @{}
    $all = Get-AnswerList
    foreach ($kind in @($all.Keys)) {
        $answer = $all[$kind][(Get-MachineId -Vm $Vm)]
        if ($answer['status'] -cne 'value') { return $answer }
        $of[$kind] = @($answer['value'])
    }
    Get-Probe -Read {
        $cpu = $of['cpu'][0]
        $memory = $of['memory'][0]
        [ordered] @{
            id = Get-MachineId -Vm $Vm; name = [string] $Vm.Name; state = [string] $Vm.State
            generation = [long] $Vm.Generation; notes = [string] $Vm.Notes
            processors = [long] $cpu.Count; reserve = [long] $cpu.Reserve; limit = [long] $cpu.Maximum
            weight = [long] $cpu.RelativeWeight
            threads_per_core = [string] (Get-Setting -Of $cpu -Name 'HwThreadCountPerCore')
            memory = [long] $memory.Startup; dynamic_memory = [bool] $memory.DynamicMemoryEnabled
            start_action = [string] $Vm.AutomaticStartAction; stop_action = [string] $Vm.AutomaticStopAction
            checkpoints = [string] $Vm.CheckpointType
            checkpoint_count = [long] $of['checkpoints'].Count
            clustered = [string] (Get-Setting -Of $Vm -Name 'IsClustered')
            replication_mode = [string] (Get-Setting -Of $Vm -Name 'ReplicationMode')
            disks = @(foreach ($one in $of['disks']) { [string] $one.Path })
        }
    }
}

function Get-VirtualDiskReading {
    # What disks that machines have are, in their order; of one that cannot be read only where it is. One whose name is a
    # pattern would be taken for other files.
    param([string[]] $Path)
    if (-not $Path.Count) { return }
    $plain = @(foreach ($one in $Path) { if (-not ($one -cmatch '[*?[\]`]')) { $one } })
    $found = Get-Probe -Many -Read { Hyper-V\Get-VHD -Path $plain }
    $whole = $found['status'] -ceq 'value' -and @($found['value']).Count -eq $Path.Count
    for ($at = 0; $at -lt $Path.Count; $at++) {
        $here = $Path[$at]
        $disk = $null
        if ($whole) { $disk = $found['value'][$at] }
        elseif ($plain -ccontains $here) { $disk = (Get-Probe -Read { Hyper-V\Get-VHD -Path $here })['value'] }
        [ordered] @{
            path = $here; type = if ($null -eq $disk) { '' } else { [string] $disk.VhdType }
            parent = if ($null -eq $disk) { '' } else { [string] $disk.ParentPath }
        }
    }
}

function Get-KeyValue {
    # The values of a registry key with their types; numbers without sign.
    param([string] $Path)
    $key = Microsoft.PowerShell.Management\Get-Item -LiteralPath $Path
    foreach ($name in $key.GetValueNames()) {
        $data = $key.GetValue($name)
        $kind = [string] $key.GetValueKind($name)
        if ($kind -ceq 'DWord') { $data = [long] $data -band 4294967295 }
        elseif ($kind -ceq 'QWord') { $data = [long] $data }
        else { $data = [string] $data }
        [ordered] @{ name = [string] $name; kind = $kind; data = $data }
    }
}

function Get-Journal {
    # What rarms keeps on this host, as it lies there, and whose it is.
    $common = if ($env:ProgramData) { $env:ProgramData } else { [Environment]::GetFolderPath('CommonApplicationData') }
    $folder = Join-Path -Path $common -ChildPath 'rarms'
    # To who may not list the folder, PowerShell 7 says of a file in it that there is none.
    [void] @(Microsoft.PowerShell.Management\Get-ChildItem -LiteralPath $folder)
    $item = Microsoft.PowerShell.Management\Get-Item -LiteralPath (Join-Path -Path $folder -ChildPath 'journal.jsonl')
    $owner = ''
    if ($env:OS -ceq 'Windows_NT') {
        $owner = (Get-Acl -LiteralPath $item.FullName).GetOwner([System.Security.Principal.SecurityIdentifier]).Value
    }
    # Get-Content shares the file with a run that is writing to it: looking must not disturb that.
    $text = '' + (Microsoft.PowerShell.Management\Get-Content -LiteralPath $item.FullName -Raw)
    [ordered] @{ owner = [string] $owner; text = $text }
}

$root = 'HKLM:\SOFTWARE\Microsoft\Windows NT\CurrentVersion'
$profile_ = $root + '\Multimedia\SystemProfile'
$namespace = 'root/virtualization/v2'
$script:Machines = $null
$script:Answers = $null
$script:Unread = @()
$document = [ordered] @{
    format = 'rarms-observation/1'
    computer = [Environment]::MachineName
    powershell = Get-Probe -Read {
        [ordered] @{ version = [string] $PSVersionTable.PSVersion; edition = [string] $PSVersionTable.PSEdition }
    }
    windows = Get-Probe -Read {
        $key = Microsoft.PowerShell.Management\Get-Item -LiteralPath $root
        [ordered] @{
            build = [long] $key.GetValue('CurrentBuildNumber'); installation = [string] $key.GetValue('InstallationType')
            bits = [long] (8 * [IntPtr]::Size)
        }
    }
    machine_id = Get-Probe -Read { Get-HostIdentity }
    elevated = Get-Probe -Read {
        $identity = [System.Security.Principal.WindowsIdentity]::GetCurrent()
        $principal = [System.Security.Principal.WindowsPrincipal]::new($identity)
        [bool] $principal.IsInRole([System.Security.Principal.WindowsBuiltInRole]::Administrator)
    }
    hyperv_administrator = Get-Probe -Read {
        $identity = [System.Security.Principal.WindowsIdentity]::GetCurrent()
        $principal = [System.Security.Principal.WindowsPrincipal]::new($identity)
        [bool] $principal.IsInRole([System.Security.Principal.SecurityIdentifier]::new('S-1-5-32-578'))
    }
    # A caller without rights sees no machines and no error; the host itself is an instance that is always there.
    host_visible = Get-Probe -Read {
        $all = @(Get-CimInstance -Namespace $namespace -ClassName Msvm_ComputerSystem)
        [bool] @(foreach ($one in $all) { if ([string] $one.Name -eq [Environment]::MachineName) { 1 } }).Count
    }
    module = Get-Probe -Many -Read {
        foreach ($one in @(Get-Module -Name 'Hyper-V' -ListAvailable)) { [string] $one.Version }
    }
    scheduler = Get-Probe -Read {
        $filter = @{ ProviderName = 'Microsoft-Windows-Hyper-V-Hypervisor'; ID = 2 }
        [long] @(Get-WinEvent -FilterHashtable $filter -MaxEvents 1)[0].Properties[0].Value
    }
    hypervisor_running = Get-Probe -Read { [bool] @(Get-CimInstance -ClassName Win32_ComputerSystem)[0].HypervisorPresent }
    counters = Get-Probe -Read {
        [bool] @(Get-CimInstance -ClassName Win32_PerfFormattedData_HvStats_HyperVHypervisorLogicalProcessor).Count
    }
    hypervisor = Get-Probe -Read {
        $vmHost = Hyper-V\Get-VMHost
        [ordered] @{
            name = [string] $vmHost.Name; logical_processors = [long] $vmHost.LogicalProcessorCount
            memory = [long] $vmHost.MemoryCapacity; numa_spanning = [bool] $vmHost.NumaSpanningEnabled
            disk_folder = [string] $vmHost.VirtualHardDiskPath
        }
    }
    processors = Get-Probe -Many -Read {
        foreach ($one in @(Get-CimInstance -ClassName Win32_Processor)) {
            [ordered] @{ name = [string] $one.Name; cores = [long] $one.NumberOfCores; logical = [long] $one.NumberOfLogicalProcessors }
        }
    }
    numa = Get-Probe -Many -Read {
        foreach ($one in @(Hyper-V\Get-VMHostNumaNode)) {
            [ordered] @{ memory_available = [long] $one.MemoryAvailable; memory = [long] $one.MemoryTotal }
        }
    }
    switches = Get-Probe -Many -Read { foreach ($one in @(Hyper-V\Get-VMSwitch)) { [string] $one.Name } }
    machines = Get-Probe -Many -Read {
        foreach ($vm in @(Get-MachineList)) {
            $found = Get-MachineReading -Vm $vm
            if ($found['status'] -ceq 'value') { $found['value'] }
            else {
                $script:Unread += [ordered] @{
                    id = Get-MachineId -Vm $vm; name = [string] $vm.Name; error = $found['error']
                    message = $found['message']
                }
            }
        }
    }
    # A machine whose settings cannot be read hides none of the others.
    unread_machines = Get-Probe -Many -Read { $script:Unread }
    virtual_disks = Get-Probe -Many -Read {
        $drives = (Get-AnswerList)['disks']
        Get-VirtualDiskReading -Path @(foreach ($vm in @(Get-MachineList)) {
            $answer = $drives[(Get-MachineId -Vm $vm)]
            foreach ($one in @(if ($answer['status'] -ceq 'value') { $answer['value'] })) { [string] $one.Path }
        })
    }
    cpu_groups = Get-Probe -Many -Read {
        foreach ($one in @(Get-CimInstance -Namespace $namespace -ClassName Msvm_ProcessorSettingData)) {
            [ordered] @{ instance = [string] $one.InstanceID; group = [string] $one.CpuGroupId; reservation = [long] $one.Reservation }
        }
    }
    firmware = Get-Probe -Many -Read {
        $vms = @(Get-MachineList | Microsoft.PowerShell.Core\Where-Object -FilterScript { $_.Generation -eq 2 })
        $answers = Get-Answer -Machines $vms -Read { Hyper-V\Get-VMFirmware -VM $script:Asked }
        foreach ($vm in $vms) {
            $found = $answers[(Get-MachineId -Vm $vm)]
            foreach ($one in @(if ($found['status'] -ceq 'value') { $found['value'] })) {
                [ordered] @{
                    machine = Get-MachineId -Vm $vm; secure_boot = [string] $one.SecureBoot
                    template = [string] $one.SecureBootTemplate
                }
            }
        }
    }
    # What guests tell of their system, and whether they can be asked to shut down, by the ids of their machines.
    guests = Get-Probe -Many -Read {
        foreach ($one in @(Get-CimInstance -Namespace $namespace -ClassName Msvm_KvpExchangeComponent)) {
            $system = @(foreach ($item in @($one.GuestIntrinsicExchangeItems)) {
                if ([string] $item -clike '*>OSName<*' -or [string] $item -clike '*>OSBuildNumber<*') { [string] $item }
            })
            [ordered] @{ machine = ([string] $one.SystemName).ToLowerInvariant(); system = $system }
        }
    }
    shutdown_services = Get-Probe -Many -Read {
        foreach ($one in @(Get-CimInstance -Namespace $namespace -ClassName Msvm_ShutdownComponent)) {
            $status = @(foreach ($each in @($one.OperationalStatus)) { [long] $each })
            $machine = ([string] $one.SystemName).ToLowerInvariant()
            [ordered] @{ machine = $machine; enabled = [long] $one.EnabledState; status = $status }
        }
    }
    profile = Get-Probe -Many -Read { Get-KeyValue -Path $profile_ }
    tasks = Get-Probe -Many -Read {
        foreach ($key in @(Microsoft.PowerShell.Management\Get-ChildItem -LiteralPath ($profile_ + '\Tasks'))) {
            [ordered] @{ name = [string] $key.PSChildName; values = @(Get-KeyValue -Path ($profile_ + '\Tasks\' + $key.PSChildName)) }
        }
    }
    records = Get-Probe -Many -Read {
        foreach ($application in @(Microsoft.PowerShell.Management\Get-ChildItem -LiteralPath 'HKLM:\SOFTWARE\rarms')) {
            $of = 'HKLM:\SOFTWARE\rarms\' + $application.PSChildName
            foreach ($task in @(Microsoft.PowerShell.Management\Get-ChildItem -LiteralPath $of)) {
                $path = 'HKLM:\SOFTWARE\rarms\{0}\{1}' -f $application.PSChildName, $task.PSChildName
                [ordered] @{
                    application = [string] $application.PSChildName; task = [string] $task.PSChildName
                    values = @(Get-KeyValue -Path $path)
                }
            }
        }
    }
    journal = Get-Probe -Read { Get-Journal }
    # By scope: the policy of this process is only what it was started with.
    execution_policy = Get-Probe -Many -Read {
        foreach ($one in @(Get-ExecutionPolicy -List)) {
            [ordered] @{ scope = [string] $one.Scope; policy = [string] $one.ExecutionPolicy }
        }
    }
}
ConvertTo-AsciiJson -Value $document
exit 0
