# --- part lock: the same bytes in every script that carries it ---------------------------------
# One run at a time on this computer, in a folder that only Administrators and SYSTEM may write to.

# A service or a logon may come without the variable; Windows knows the folder all the same.
$common = if ($env:ProgramData) { $env:ProgramData } else { [Environment]::GetFolderPath('CommonApplicationData') }
$script:Folder = Join-Path -Path $common -ChildPath 'rarms'
$script:Operator = '{0}@{1}, process {2}' -f [Environment]::UserName, [Environment]::MachineName, $PID
$script:OwnerFile = ''       # it says who holds the mutex, once that is us
$script:Mutex = $null

function Lock-Host {
    # One run at a time on this computer. Windows hands over what a dead process held. A preview does not wait.
    if ($WhatIfPreference) { return }
    $path = Join-Path -Path $script:Folder -ChildPath 'owner.txt'
    $owner = if (Test-Path -LiteralPath $path) { [System.IO.File]::ReadAllText($path) } else { 'an unknown user' }
    $held = $false
    try {
        $mutex = [System.Threading.Mutex]::new($false, 'Global\rarms')
        $held = $mutex.WaitOne(1000 * $LockTimeout)
    } catch [System.Threading.AbandonedMutexException] {
        $held = $true
        Write-RunEvent -Kind 'lock' -Status 'taken over' -Detail ('it was held by ' + $owner)
    } catch [System.UnauthorizedAccessException] {
        # Made by an account that lets no other open it, so it is alive.
        Write-Verbose -Message $_.Exception.Message
    }
    if (-not $held) { Stop-Run -Kind 'lock' -Detail ('it is held by ' + $owner) }
    $script:Mutex = $mutex
    # Only Administrators and SYSTEM may write what a later run trusts; a killed run may have left it open to everybody.
    if (Test-Path -LiteralPath $script:Folder) { Assert-Owner -Path $script:Folder }
    else { [void] [System.IO.Directory]::CreateDirectory($script:Folder) }
    if (Test-Path -LiteralPath $path) { Assert-Owner -Path $path }
    Protect-Path -Path $script:Folder -Descriptor 'O:BAG:SYD:P(A;OICI;FA;;;BA)(A;OICI;FA;;;SY)'
    [System.IO.File]::WriteAllText($path, $script:Operator)
    $script:OwnerFile = $path
}

function Unlock-Host {
    if ($script:OwnerFile) {
        try { [System.IO.File]::Delete($script:OwnerFile) } catch { Write-Verbose -Message $_.Exception.Message }
    }
    if ($null -ne $script:Mutex) { $script:Mutex.ReleaseMutex() }
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
