# Measuring: make test partitions, run components and loads inside their guests, and remove the partitions at the end.
# rarms writes the next setting into the file next to this script that ends with .next: `3 run 45 55.` or `4 rest.`

function Invoke-RarmsMeasuring {
    <#
    .SYNOPSIS
        Make test partitions, measure in them and remove them, also after an error.
    .PARAMETER Run
        The table of a script, as Invoke-RarmsPlan gets it.
    #>
    [CmdletBinding()]
    param([Parameter(Mandatory)] [System.Collections.IDictionary] $Run)
    $script:Held = $false
    try {
        Initialize-Run -Run $Run
        $script:Tests = @()         # test partitions, in the order of the reserves in a setting
        $script:TestFolder = '[\\/]rarms-p(?:1|2[bc]?)(\.rarms-0{12})?$'
        $script:TestDisk = '[\\/]rarms-p(?:1|2[bc]?)-0{12}\.vhdx?$'
        $script:Works = @()         # components and loads inside guests
        $script:Sessions = Get-OrdinalTable  # by number of a component or load: the session into its guest
        $script:Secrets = Get-OrdinalTable  # by name: the user and password of a guest
        $script:Jobs = @()          # components and loads that run now
        $script:Receiver = $null    # the process of the receiver
        $script:Setting = ''        # the last setting that rarms wrote
        $script:Clock = [System.Diagnostics.Stopwatch]::StartNew()  # runs since the setting began
        $script:Due = [long] 0      # time on the clock at which the counters are read next, in ms
        if ($Run.Test) { throw 'a measurement has no state to test: start the script without -Test' }
        $bound = $MyInvocation.MyCommand.Module.NewBoundScriptBlock($Run.Plan)
        & $bound
        if ($script:Preview) {
            foreach ($test in $script:Tests) {
                Write-Progressed -Partition $test.Name -Status 'previewed' -Detail 'would be made'
            }
        } else {
            Complete-Measurement -Abandon $Run.Abandon
        }
        $script:Code = 0
    } catch {
        Write-Failure -Failure $_
    } finally {
        try { if ($script:Held) { Remove-Measurement } } finally {
            Unlock-Host
            $Run.ExitCode.Value = $script:Code
        }
    }
}

function Complete-Measurement {
    param([bool] $Abandon)
    if ($Abandon) { throw 'a measurement has no unfinished run: start the script without -Abandon' }
    Lock-Host
    $script:Held = $true
    Assert-VmHost
    # Report an unreadable password before anything is made.
    foreach ($work in $script:Works) { $script:Secrets[$work.Logon] = Get-GuestSecret -Name $work.Logon }
    Remove-TestPartition -Tell
    foreach ($test in $script:Tests) { Add-TestMachine -Test $test }
    foreach ($work in $script:Works) { Connect-Guest -Work $work }
    Write-Progressed -Partition '' -Status 'reading' -Detail 'ready'
    while ($script:Works.Count -and -not (Test-Stopped)) { Step-Setting }
    Remove-Measurement
    Write-RunEvent -Kind 'run' -Status 'done'
}

function Test-Stopped {
    # Whether to end: rarms wrote the .stop file, or the receiver that started this script is gone.
    if (Microsoft.PowerShell.Management\Test-Path -LiteralPath ($script:Run.ScriptPath + '.stop')) { return $true }
    if (-not $env:RARMS_RECEIVER) { return $false }
    try {
        $known = $null -ne $script:Receiver
        if (-not $known) { $script:Receiver = [System.Diagnostics.Process]::GetProcessById($env:RARMS_RECEIVER) }
        $script:Receiver.HasExited
    } catch {
        Write-Verbose -Message $_.Exception.Message
        $true
    }
}

function Remove-Measurement {
    # Do not write output here: the listener may be gone. Remove a partition also if its guest does not answer.
    try {
        Stop-Work
        foreach ($session in $script:Sessions.Values) { Remove-PSSession -Session $session }
        $script:Sessions.Clear()
    } finally { Remove-TestPartition }
}

function Write-Progressed {
    param([string] $Partition, [string] $Status, [string] $Detail)
    $at = if ($Partition) { 'partition/' + $Partition } else { 'host' }
    $script:Current = @{ Address = $at; Number = 0; After = @{
        mark = '{0}/{1}' -f $script:Plan.Application, $Partition; set = $script:Plan.Plan
    } }
    Write-RunEvent -Kind 'step' -Step $script:Current -Status $Status -Detail $Detail
}

function Step-Setting {
    # Every tenth of a second, read the next setting and the output of the guests. Every second, read the counters.
    $next = Get-NextSetting
    if ($next -cne $script:Setting) { Use-Setting -Next $next }
    foreach ($job in $script:Jobs) {
        foreach ($line in @(Receive-Job -Job $job.Job)) { Write-Seen -Name $job.Name -Seen ([string] $line) }
        if (@('NotStarted', 'Running') -cnotcontains [string] $job.Job.State) {
            throw ('{0} ended inside its guest: {1}' -f $job.Name, $job.Job.State)
        }
    }
    if ($script:Jobs.Count -and $script:Clock.ElapsedMilliseconds -ge $script:Due) {
        Write-Counter
        while ($script:Due -le $script:Clock.ElapsedMilliseconds) { $script:Due += 1000 }  # reading may take seconds
    }
    Start-Sleep -Milliseconds 100
}

function Get-NextSetting {
    # A setting counts when its line is complete. If there are two lines, take the newer one.
    $path = $script:Run.ScriptPath + '.next'
    $text = ''
    if (Microsoft.PowerShell.Management\Test-Path -LiteralPath $path) { $text += Read-SharedFile -Path $path }
    if ($text -cmatch '[0-9]+ (?:rest|run(?: [0-9]{1,3})*)\.$') { $Matches[0] } else { $script:Setting }
}

function Use-Setting {
    # End all programs, lower reserves before others are raised, then start the programs again.
    param([string] $Next)
    Stop-Work
    $script:Setting = $Next
    $words = @(($Next -creplace '\.$', '') -csplit ' ')
    if ($words[1] -ceq 'rest') { return }
    foreach ($grows in @($false, $true)) {
        for ($at = 0; $at -lt $script:Tests.Count; $at++) {
            $test = $script:Tests[$at]
            $vm = Hyper-V\Get-VM -Id $test.Machine
            $now = [long] (Hyper-V\Get-VMProcessor -VM $vm).Reserve
            $wanted = [long] $words[$at + 2]
            if ($now -eq $wanted -or ($now -lt $wanted) -ne $grows) { continue }
            Hyper-V\Set-VMProcessor -VM $vm -Reserve $wanted
        }
    }
    foreach ($work in $script:Works) { if (-not $work.Request.Name) { Start-Work -Work $work -Words $words } }
    Wait-Load
    $script:Clock = [System.Diagnostics.Stopwatch]::StartNew()
    $script:Due = [long] 0
    foreach ($work in $script:Works) { if ($work.Request.Name) { Start-Work -Work $work -Words $words } }
    Write-Seen -Name '' -Seen 'begun'
}

function Start-Work {
    param([System.Collections.IDictionary] $Work, [string[]] $Words)
    $session = $script:Sessions[[string] $Work.number]
    for ($at = 0; $at -lt $script:Tests.Count; $at++) {
        if ($script:Tests[$at].Name -ceq $Work.Partition) { $Work.Request.reserve = [long] $Words[$at + 2] }
    }
    $request = ConvertTo-AsciiJson -Value $Work.Request
    $job = Invoke-Command -Session $session -ScriptBlock (Get-GuestRunner) -ArgumentList $request -AsJob
    $script:Jobs += @{ Name = $Work.Request.Name; Job = $job }
}

function Wait-Load {
    # Wait until each load runs, and until bursts know how much a processor does on an idle machine.
    foreach ($job in $script:Jobs) {
        while (-not (@(Receive-Job -Job $job.Job) -join '').Contains('loaded')) {
            if (@('NotStarted', 'Running') -cnotcontains [string] $job.Job.State) {
                throw ('{0} ended inside its guest: {1}' -f $job.Name, $job.Job.State)
            }
            if (Test-Stopped) { return }
            Start-Sleep -Milliseconds 100
        }
    }
}

function Stop-Work {
    # End the programs inside guests: the runner in the guest ends its processes.
    foreach ($job in $script:Jobs) { Remove-Job -Job $job.Job -Force }
    $script:Jobs = @()
}

function Write-Seen {
    # Write a line for rarms with the setting and this computer's time.
    param([string] $Name, [string] $Seen)
    ConvertTo-AsciiJson -Value ([ordered] @{
        format = 'rarms-seen/1'; setting = $script:Setting; name = $Name; seen = $Seen
        at_ms = $script:Clock.ElapsedMilliseconds
    })
}

function Write-Counter {
    # Write the counters of the hypervisor, for each machine and for all processors: run times in 100 ns, waits in ns,
    # dispatches.
    $due = $script:Due
    foreach ($set in @('Virtual Processor', 'Logical Processor', 'Root Virtual Processor')) {
        $class = 'Win32_PerfRawData_HvStats_HyperVHypervisor' + ($set -creplace ' ', '')
        $seen = Get-OrdinalTable
        foreach ($one in @(Get-CimInstance -ClassName $class)) {
            $of = [string] $one.Name -creplace ':?(Hv LP|Hv VP|Root VP) [0-9]+$', ''
            if ($of -ceq $one.Name) { continue }  # a total of several
            $more = @($one.PercentTotalRunTime, $one.PercentGuestRunTime, $one.PercentHypervisorRunTime)
            if ($of) { $more += @($one.CPUWaitTimePerDispatch, $one.CPUWaitTimePerDispatch_Base) }
            for ($at = 0; $at -lt $more.Count -and $seen.Contains($of); $at++) {
                $more[$at] = [long] $more[$at] + [long] $seen[$of][$at]
            }
            $seen[$of] = $more
        }
        foreach ($of in @(Get-Sorted -Text @($seen.Keys))) {
            $name = 'Hyper-V Hypervisor ' + $set
            if ($of) { $name += '(' + $of + ')' }
            Write-Seen -Name $name -Seen ('counted ' + $due + ' ' + ($seen[$of] -join ' '))
        }
    }
}
