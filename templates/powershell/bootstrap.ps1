#Requires -Version 5.1
# rarms receiver: what the loader runs. It takes scripts from the rest of standard input, checks their SHA-256, keeps them
# in a new folder that only its user can read, runs the first, passes its exit code on, and removes them.
# Input: 8 digits, the length of a table; the table, one line for the arguments and one `name length sha256` a file;
# then the files' bytes. Text that ends with a dot after that, `3 run 45 55.`, is laid beside the script, which reads it;
# `o` says that nothing follows and the script goes on; anything else, or the end of the input, asks it to stop before its
# next step.
param([System.IO.Stream] $Source)

$PSDefaultParameterValues = @{}
Set-StrictMode -Version 3.0
$ErrorActionPreference = 'Stop'
$ProgressPreference = 'SilentlyContinue'

function Read-All {
    # Fills the array; the connection must not end before.
    param([System.IO.Stream] $From, [byte[]] $Into)
    $at = 0
    while ($at -lt $Into.Length) {
        $count = $From.Read($Into, $at, $Into.Length - $at)
        if ($count -eq 0) { throw 'the input ended too early' }
        $at += $count
    }
}

$code = 90
$folder = ''
try {
    $ascii = [System.Text.Encoding]::ASCII
    $data = [byte[]]::new(8)
    Read-All -From $Source -Into $data
    $data = [byte[]]::new([int] $ascii.GetString($data))
    Read-All -From $Source -Into $data
    $table = @($ascii.GetString($data) -split '\n')
    if ($table[0] -cnotmatch '^( |-AsJson|-Force|-Abandon|-LockTimeout [0-9]{1,6})*$') { throw 'bad arguments' }
    if ($env:OS -ceq 'Windows_NT') {
        $folder = [System.IO.Path]::GetTempPath() + 'rarms-' + [guid]::NewGuid().ToString('N')
        [void] [System.IO.Directory]::CreateDirectory($folder)
        $user = [System.Security.Principal.WindowsIdentity]::GetCurrent().User.Value
        $acl = Get-Acl -LiteralPath $folder
        $acl.SetSecurityDescriptorSddlForm('D:P(A;OICI;FA;;;' + $user + ')', 'Access')
        Set-Acl -LiteralPath $folder -AclObject $acl
    } else {
        $folder = [System.IO.Directory]::CreateTempSubdirectory('rarms-').FullName
    }
    $main = ''
    for ($at = 1; $at -lt $table.Count; $at++) {
        $part = @($table[$at] -split ' ')
        if ($part[0] -cnotmatch '^([a-z0-9][a-z0-9.-]*\.ps1|Rarms/Rarms\.ps[dm]1)$') { throw 'bad name' }
        $data = [byte[]]::new([int] $part[1])
        Read-All -From $Source -Into $data
        $sum = [System.BitConverter]::ToString([System.Security.Cryptography.SHA256]::Create().ComputeHash($data))
        if ($sum.Replace('-', '').ToLowerInvariant() -cne $part[2]) { throw ($part[0] + ' is not what was sent') }
        $path = [System.IO.Path]::Combine($folder, $part[0])
        [void] [System.IO.Directory]::CreateDirectory([System.IO.Path]::GetDirectoryName($path))
        [System.IO.File]::WriteAllBytes($path, $data)
        if (-not $main) { $main = $path }
    }
    $start = [System.Diagnostics.ProcessStartInfo]::new()
    $start.FileName = [System.Diagnostics.Process]::GetCurrentProcess().MainModule.FileName
    $form = '-NoProfile -NonInteractive -ExecutionPolicy RemoteSigned -File "{0}" {1}'
    $start.Arguments = $form -f $main, $table[0]
    $start.UseShellExecute = $false
    $start.RedirectStandardInput = $true
    $child = [System.Diagnostics.Process]::Start($start)
    $child.StandardInput.Close()
    $data = [byte[]]::new(99)
    $more = $Source.ReadAsync($data, 0, 99)
    while (-not $child.WaitForExit(200)) {
        if ($null -eq $more -or -not $more.IsCompleted) { continue }
        $line = $ascii.GetString($data, 0, $more.Result)
        $more = $null
        if ($line -ceq 'o') { continue }
        $kind = if ($line -cmatch '\.$') { '.next' } else { '.stop' }
        [System.IO.File]::WriteAllText($main + $kind, $line)
        $more = if ($line) { $Source.ReadAsync($data, 0, 99) }
    }
    $code = $child.ExitCode
} catch {
    [Console]::Out.WriteLine('rarms-bootstrap/1 failed ' + ($_.Exception.Message -replace '\s+', ' '))
} finally {
    try {
        if ($folder) { [System.IO.Directory]::Delete($folder, $true) }
    } catch {
        [Console]::Error.WriteLine('rarms could not remove ' + $folder)
    }
}
exit $code
