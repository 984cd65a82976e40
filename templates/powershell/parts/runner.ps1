# Programs inside guests. Each has its own session, in which the runner starts the program and reads its output.

function Add-GuestWork {
    # Add a program for a guest. Kinds: lines (pass on its output), runs (one process for each job), load, and
    # calibrated (a load that writes a line when it has measured the speed of a processor).
    param(
        [string] $Partition, [string] $Logon, [string] $Name, [string] $Kind, [string] $Program,
        [string] $Arguments, [string] $Environment, [string] $Files, [long] $PeriodTicks, [long] $TimeoutMs,
        [long] $Instances
    )
    $script:Works += @{
        number = $script:Works.Count; Partition = $Partition; Logon = $Logon; Request = [ordered] @{
            Name = $Name; kind = $Kind; program = $Program; arguments = $Arguments; environment = $Environment
            files = $Files; period_ticks = $PeriodTicks; timeout_ms = $TimeoutMs; instances = $Instances
            reserve = [long] 0
        }
    }
}

function Connect-Guest {
    # Open a session into the guest of a partition with PowerShell Direct, as soon as its Windows answers.
    param([System.Collections.IDictionary] $Work)
    $at = $Work.Partition
    $secret = $script:Secrets[$Work.Logon]
    $until = [DateTime]::UtcNow.AddMilliseconds(600000)
    while ($true) {
        try {
            $session = New-PSSession -VMId (Find-WorkMachine -Partition $at).Id -Credential $secret
            $script:Sessions[[string] $Work.number] = $session
            return
        } catch {
            # A guest that is still starting gives the same error as a wrong password.
            $problem = [string] $_.Exception.Message
            $late = -not ([DateTime]::UtcNow -lt $until) -or (Test-Stopped)
            if ($null -ne $script:Ending -or $late) { throw $problem }
            Write-Progressed -Partition $at -Status 'reading' -Detail $problem
        }
        Start-Sleep -Milliseconds 3000
    }
}

function Find-WorkMachine {
    # Return the running machine of a partition of this application. The mark identifies it.
    param([string] $Partition)
    foreach ($vm in @(Hyper-V\Get-VM)) {
        $mark = Get-Mark -Vm $vm
        if ($mark.Name -cne $Partition -or $mark.Application -cne $script:Plan.Application) { continue }
        if ((ConvertTo-RunState -State $vm.State) -ceq 'running') { return $vm }
    }
    Exit-Run -Detail ('partition {0} of {1} is not running' -f $Partition, $script:Plan.Application)
}

function Get-GuestSecret {
    # Return the credential that this account stored for guests on this computer. The file has one line with the user,
    # and one line with the password from ConvertFrom-SecureString.
    param([string] $Name)
    $path = '{0}\credentials\{1}.txt' -f $script:Folder, ($Name -creplace '/', '_')
    $text = Read-SharedFile -Path $path
    if ($null -eq $text) { Exit-Run -Detail ('the credential {0} is missing' -f $path) }
    Assert-Owner -Path $path
    $data = [System.Text.Encoding]::GetEncoding(28591).GetBytes($text)
    $lines = @([System.Text.Encoding]::UTF8.GetString($data) -csplit '\r?\n')
    try { $password = ConvertTo-SecureString -String $lines[1] }
    catch {
        $text = '{0} was written by another user or on another computer. Write it again here, as {1}: '
        $text += '$guest = Get-Credential; Set-Content -LiteralPath {0} -Value $guest.UserName, '
        $text += '(ConvertFrom-SecureString $guest.Password)'
        Exit-Run -Detail ($text -f $path, [Environment]::UserName)
    }
    [System.Management.Automation.PSCredential]::new($lines[0], $password)
}

function Get-GuestRunner {
    # Return a block for Invoke-Command.
    {
        # This block runs inside a guest. Times are in 100 ns since its start.
        param([string] $Request)
        Set-StrictMode -Version 3.0
        $ErrorActionPreference = 'Stop'
        $work = ConvertFrom-Json -InputObject $Request
        $clock = [System.Diagnostics.Stopwatch]::StartNew()
        $running = @()
        try {
            # A guard process waits for the end of this session, then ends the processes that it started.
            $guard = '-NoProfile -Command Wait-Process -Id {0}; ' -f $PID
            $guard += 'Get-CimInstance Win32_Process -Filter ParentProcessId={0}' -f $PID
            # The guard is a child of the session too, so it must not end itself.
            $guard += ' | Where-Object ProcessId -ne $PID | ForEach-Object { Stop-Process -Id $_.ProcessId -Force }'
            $start = [System.Diagnostics.ProcessStartInfo]::new('powershell.exe', $guard)
            $start.UseShellExecute = $false
            $running += [System.Diagnostics.Process]::Start($start)
            $folder = [System.IO.Path]::GetTempPath() + 'rarms-work'
            [void] [System.IO.Directory]::CreateDirectory($folder)
            foreach ($file in (ConvertFrom-Json -InputObject $work.files).PSObject.Properties) {
                $path = [System.IO.Path]::Combine($folder, $file.Name)
                [void] [System.IO.Directory]::CreateDirectory([System.IO.Path]::GetDirectoryName($path))
                [System.IO.File]::WriteAllBytes($path, [System.Convert]::FromBase64String($file.Value))
            }
            $program = [System.IO.Path]::Combine($folder, $work.program)
            if (-not ([System.IO.File]::Exists($program))) { $program = $work.program }
            $start = [System.Diagnostics.ProcessStartInfo]::new($program, $work.arguments)
            $start.UseShellExecute = $false
            $start.WorkingDirectory = $folder
            $start.RedirectStandardOutput = $work.kind -cne 'load'
            foreach ($one in (ConvertFrom-Json -InputObject $work.environment).PSObject.Properties) {
                $start.EnvironmentVariables[$one.Name] = [string] $one.Value
            }
            $start.EnvironmentVariables['RARMS_RESERVE'] = [string] $work.reserve
            if (@('load', 'calibrated') -ccontains $work.kind) {
                for ($number = 0; $number -lt $work.instances; $number++) {
                    $process = [System.Diagnostics.Process]::Start($start)
                    $running += $process
                    if ($work.kind -ceq 'load') { continue }
                    $read = $process.StandardOutput.ReadLineAsync()
                    while (-not $read.Wait(250)) { continue }  # short waits, so that Remove-Job can end this block
                }
                'loaded {0}' -f $clock.Elapsed.Ticks
                while ($true) {
                    Start-Sleep -Milliseconds 500
                    foreach ($process in $running) { if ($process.HasExited) { throw 'a process of the load ended' } }
                }
            }
            $due = [long] 0
            while ($true) {
                while ($work.kind -ceq 'runs' -and $clock.Elapsed.Ticks -lt $due) { Start-Sleep -Milliseconds 1 }
                if (-not $work.period_ticks -or $due -eq 0) { $due = $clock.Elapsed.Ticks }
                $process = [System.Diagnostics.Process]::Start($start)
                $running = @($running[0], $process)
                'started {0}' -f $due
                $limit = $clock.Elapsed.Ticks + 10000 * $work.timeout_ms
                $late = $false
                $line = ''
                while ($null -ne $line -and -not $late) {
                    # Use short waits, so that Remove-Job can end this block.
                    $read = $process.StandardOutput.ReadLineAsync()
                    while (-not $late -and -not $read.Wait(250)) { $late = $clock.Elapsed.Ticks -gt $limit }
                    $line = if ($late) { $null } else { $read.Result }
                    if ($null -ne $line -and $work.kind -ceq 'lines') {
                        'line {0} {1}' -f $clock.Elapsed.Ticks, $line
                        $limit = $clock.Elapsed.Ticks + 10000 * $work.timeout_ms
                    }
                }
                # The program may run on after it closed its output, or end just before Kill.
                while (-not $process.WaitForExit(250)) {
                    $late = $late -or $clock.Elapsed.Ticks -gt $limit
                    if ($late) { try { $process.Kill() } catch { Write-Verbose -Message $_.Exception.Message } }
                }
                $now = $clock.Elapsed.Ticks
                if ($late) { 'late {0} {1}' -f $due, $now }
                else { 'ended {0} {1} {2}' -f $due, $now, $process.ExitCode }
                $due += [long] $work.period_ticks
            }
        } finally {
            foreach ($process in $running) {
                try { $process.Kill() } catch { Write-Verbose -Message $_.Exception.Message }  # most have ended already
            }
        }
    }
}
