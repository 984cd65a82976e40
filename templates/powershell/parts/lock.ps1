# --- part lock: the same bytes in every script that carries it ---------------------------------
# One run at a time on this computer, in a folder that only Administrators and SYSTEM may write to.

# A service or a logon may come without the variable; Windows knows the folder all the same.
$common = if ($env:ProgramData) { $env:ProgramData } else { [Environment]::GetFolderPath('CommonApplicationData') }
$script:Folder = Join-Path -Path $common -ChildPath 'rarms'
$script:Operator = '{0}@{1}, process {2}' -f [Environment]::UserName, [Environment]::MachineName, $PID
$script:OwnerFile = Join-Path -Path $script:Folder -ChildPath 'owner.txt'
$script:Handle = $null       # of that file while this run holds the computer; it ends with its process

function Lock-Host {
    # A preview holds nothing. The folder comes first: no other account may open, and so hold, what lies in it.
    if ($WhatIfPreference) { return }
    $path = $script:OwnerFile
    # Only Administrators and SYSTEM may write what a later run trusts; a killed run may have left it open to all.
    if (Test-Path -LiteralPath $script:Folder) { Assert-Owner -Path $script:Folder }
    else { [void] [System.IO.Directory]::CreateDirectory($script:Folder) }
    if (Test-Path -LiteralPath $path) { Assert-Owner -Path $path }
    Protect-Path -Path $script:Folder -Descriptor 'O:BAG:SYD:P(A;OICI;FA;;;BA)(A;OICI;FA;;;SY)'
    $until = [DateTime]::UtcNow.AddMilliseconds(1000 * $LockTimeout)
    $mode = [System.IO.FileMode]::OpenOrCreate
    while ($null -eq $script:Handle) {
        try {
            $access = [System.IO.FileAccess]::Write
            $script:Handle = [System.IO.FileStream]::new($path, $mode, $access, [System.IO.FileShare]::Read)
        } catch [System.IO.IOException] {
            if (-not ([DateTime]::UtcNow -lt $until)) { Stop-Run -Kind 'lock' -Detail ('it is held by ' + (Get-Holder)) }
            Start-Sleep -Milliseconds 500
        }
    }
    [byte[]] $data = [System.Text.Encoding]::ASCII.GetBytes($script:Operator)
    $script:Handle.SetLength(0)
    $script:Handle.Write($data, 0, $data.Length)
    $script:Handle.Flush($true)
}

function Get-Holder {
    # Who holds this computer. It is open for writing, so it is opened shared for that.
    $text = ''
    try {
        $access = [System.IO.FileAccess]::Read
        $share = [System.IO.FileShare]::ReadWrite
        $stream = [System.IO.FileStream]::new($script:OwnerFile, [System.IO.FileMode]::Open, $access, $share)
        try {
            $data = [byte[]]::new(300)
            $text = [System.Text.Encoding]::ASCII.GetString($data, 0, $stream.Read($data, 0, 300))
        } finally {
            $stream.Dispose()
        }
    } catch {
        Write-Verbose -Message $_.Exception.Message
    }
    if ($text) { $text } else { 'an unknown user' }
}

function Unlock-Host {
    if ($null -eq $script:Handle) { return }
    $script:Handle.Dispose()
    # Another run may hold it by now.
    try { [System.IO.File]::Delete($script:OwnerFile) } catch { Write-Verbose -Message $_.Exception.Message }
}

function Protect-Path {
    # The owner is said, not left to the account: what a policy or an ssh logon makes of new files differs.
    param([string] $Path, [string] $Descriptor)
    if ($env:OS -cne 'Windows_NT') { return }
    # -Confirm asks for steps, not for what rarms keeps for itself.
    $ConfirmPreference = 'None'
    $acl = Get-Acl -LiteralPath $Path
    $acl.SetSecurityDescriptorSddlForm($Descriptor)
    Set-Acl -LiteralPath $Path -AclObject $acl
}

function Assert-Owner {
    # A planted journal or folder must not tell an administrator what to do, nor lead elsewhere.
    param([string] $Path)
    if ($env:OS -cne 'Windows_NT') { return }
    if ([System.IO.File]::GetAttributes($Path) -band [System.IO.FileAttributes]::ReparsePoint) {
        throw ('{0} is a link: look where it leads, then remove it' -f $Path)
    }
    $owner = (Get-Acl -LiteralPath $Path).GetOwner([System.Security.Principal.SecurityIdentifier]).Value
    if (@('S-1-5-32-544', 'S-1-5-18') -ccontains $owner) { return }
    throw ('{0} belongs to {1}, not to Administrators or SYSTEM: look at it, then remove it' -f $Path, $owner)
}
# --- end of the part lock ----------------------------------------------------------------------
