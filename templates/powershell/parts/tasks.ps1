# --- part tasks: the same bytes in every script that carries it --------------------------------
# How multimedia task classes are read and written, each value with its type, and what rarms keeps of them.

$script:ProfileRoot = 'HKLM:\SOFTWARE\Microsoft\Windows NT\CurrentVersion\Multimedia\SystemProfile'
$script:RecordRoot = 'HKLM:\SOFTWARE\rarms'

function Get-TaskClassReading {
    # Values with their types, and our record: whose it is and what was last written.
    param([string] $Task)
    $live = [hashtable]::new($script:Ordinal)
    $live['exists'] = $false
    foreach ($name in @('values', 'record', 'set')) { $live[$name] = '' }
    $live['empty'] = Test-EmptyKey -Task $Task
    [string[]] $names = @(foreach ($name in @(Get-TaskValueName -Task $Task)) { $name.ToLowerInvariant() })
    [Array]::Sort($names, [System.StringComparer]::Ordinal)
    foreach ($name in $names) {
        $key = Get-Item -LiteralPath (Get-TaskPath -Task $Task)
        $kind = ([string] $key.GetValueKind($name)).ToLowerInvariant()
        $data = $key.GetValue($name)
        if ($kind -ceq 'dword') { $data = [long] $data -band 4294967295 }
        $live['value:' + $name] = '{0}:{1}' -f ($kind -creplace '^string$', 'sz'), $data
        $live['exists'] = $true
        # Windows does not tell the case of a value's name apart.
        $live['values'] = $names -join ', '
    }
    if (-not (Test-Path -LiteralPath $script:RecordRoot)) { return $live }
    foreach ($application in @(Get-ChildItem -LiteralPath $script:RecordRoot)) {
        $path = Get-RecordPath -Task $Task -Application $application.PSChildName
        if (-not (Test-Path -LiteralPath $path)) { continue }
        $set = [string] (Get-Item -LiteralPath $path).GetValue('set')
        if ($set) {
            $live['record'] = [string] $application.PSChildName
            $live['set'] = $set
        }
    }
    $live
}

function Get-TaskValueName {
    # The names of a task class's values; of the key above the classes only the one that is meant.
    param([string] $Task)
    $path = Get-TaskPath -Task $Task
    if (-not (Test-Path -LiteralPath $path)) { return }
    foreach ($name in @((Get-Item -LiteralPath $path).GetValueNames())) {
        if ($path -cne $script:ProfileRoot -or $name -eq $Task) { $name }
    }
}

function Get-TaskPath {
    # SystemResponsiveness is one value of the key above the task classes; our record of it lies among theirs.
    param([string] $Task)
    if ($Task -ceq 'SystemResponsiveness') { return $script:ProfileRoot }
    '{0}\Tasks\{1}' -f $script:ProfileRoot, $Task
}

function Write-TaskValue {
    # A value that is there already is left: a step that was killed goes on where it stopped.
    param([string] $Task, [string] $Name, [string] $Type, $Value)
    $path = Get-TaskPath -Task $Task
    Add-Key -Path $path
    $wanted = '{0}:{1}' -f ($Type.ToLowerInvariant() -creplace '^string$', 'sz'), $Value
    $live = Get-TaskClassReading -Task $Task
    $there = [string] $live['value:' + $Name.ToLowerInvariant()]
    if ([string]::Equals($there, $wanted, [System.StringComparison]::Ordinal)) { return }
    [void] (New-ItemProperty -LiteralPath $path -Name $Name -PropertyType $Type -Value $Value -Force)
}

function Remove-TaskValue {
    # Takes one value away; with -Keep every value but these, whose names are joined as readings join them.
    param([string] $Task, [string] $Name = '', [string] $Keep = '')
    foreach ($one in @(Get-TaskValueName -Task $Task)) {
        $goes = if ($Keep) { @($Keep -split ', ') -notcontains $one } else { $one -eq $Name }
        if ($goes) { Remove-ItemProperty -LiteralPath (Get-TaskPath -Task $Task) -Name $one }
    }
}

function Remove-TaskClass {
    param([string] $Task)
    $path = Get-TaskPath -Task $Task
    if ($path -ceq $script:ProfileRoot) { throw 'the profile itself is no task class, and is never removed' }
    Remove-Key -Path $path
}

function Write-TaskRecord {
    # What was there before comes first, the digest last: without it the record does not count.
    param([string] $Task, [string] $Application, [string] $Digest, [string] $Before)
    $path = Get-RecordPath -Task $Task -Application $Application
    Add-Key -Path $script:RecordRoot
    Add-Key -Path ('{0}\{1}' -f $script:RecordRoot, $Application)
    Add-Key -Path $path
    foreach ($one in @(@('before', $Before), @('set', $Digest))) {
        # What is there already is left: a step that was killed goes on where it stopped.
        $there = [string] (Get-Item -LiteralPath $path).GetValue($one[0])
        if ([string]::Equals($there, $one[1], [System.StringComparison]::Ordinal)) { continue }
        [void] (New-ItemProperty -LiteralPath $path -Name $one[0] -PropertyType String -Value $one[1] -Force)
    }
}

function Remove-TaskRecord {
    # With the keys above it that hold nothing else.
    param([string] $Task, [string] $Application)
    Remove-Key -Path (Get-RecordPath -Task $Task -Application $Application)
    foreach ($path in @(('{0}\{1}' -f $script:RecordRoot, $Application), $script:RecordRoot)) {
        if (Test-BareKey -Path $path) { Remove-Key -Path $path }
    }
}

function Test-EmptyKey {
    # Whether a kill left keys that hold nothing: a class without values, a record without its digest, or ours above it.
    param([string] $Task)
    $application = '{0}\{1}' -f $script:RecordRoot, $script:Plan.Application
    $record = '{0}\{1}' -f $application, $Task
    foreach ($path in @((Get-TaskPath -Task $Task), $application, $script:RecordRoot)) {
        if (Test-BareKey -Path $path) { return $true }
    }
    (Test-Path -LiteralPath $record) -and -not (Get-Item -LiteralPath $record).GetValue('set')
}

function Test-BareKey {
    # Whether a key is there and holds neither values nor keys.
    param([string] $Path)
    if (-not (Test-Path -LiteralPath $Path)) { return $false }
    -not (@(Get-ChildItem -LiteralPath $Path).Count + @((Get-Item -LiteralPath $Path).GetValueNames()).Count)
}

function Get-RecordPath {
    # Ours, never below the multimedia keys.
    param([string] $Task, [string] $Application)
    '{0}\{1}\{2}' -f $script:RecordRoot, $Application, $Task
}

function Add-Key {
    # Never with -Force, which would empty a key that is there.
    param([string] $Path)
    if (-not (Test-Path -LiteralPath $Path)) { [void] (New-Item -Path $Path) }
}

function Remove-Key {
    param([string] $Path)
    if (Test-Path -LiteralPath $Path) { Remove-Item -LiteralPath $Path }
}
# --- end of the part tasks ---------------------------------------------------------------------
