# Compiles the cmdlets, once for a digest of their text.
param([string] $Sources, [string] $Modules)
$ErrorActionPreference = 'Stop'
$dll = [System.IO.Path]::Combine($Modules, 'RarmsModel', 'RarmsModel.dll')
# No name of .NET that Rename gives to ours may be read here: PowerShell keeps what it found.
if (-not (Test-Path -LiteralPath $dll)) {
    $references = @(Get-ChildItem -Path ([System.IO.Path]::Combine($PSHOME, 'ref', '*.dll')))
    $references = @(foreach ($one in $references) { $one.FullName })
    foreach ($type in [psobject], [Microsoft.PowerShell.Commands.NewItemCommand], [System.Diagnostics.EventLogEntryType]) {
        $references += $type.Assembly.Location
    }
    # The compiler of Windows PowerShell 5.1 knows C# 5 only, and takes no options as text.
    $options = @(if ($PSVersionTable['PSEdition'] -eq 'Core') { '/langversion:5' })
    if ($PSVersionTable['Platform'] -eq 'Unix') {
        $options += '/define:LINUX'
        $references += [System.IO.Path]::Combine($PSHOME, 'Microsoft.PowerShell.ConsoleHost.dll')
    }
    $more = if ($options) { @{ CompilerOptions = $options } } else { @{} }
    $files = @(foreach ($one in @(Get-ChildItem -Path ([System.IO.Path]::Combine($Sources, '*.cs')))) { $one.FullName })
    # Elsewhere first: what a killed process left half-made is never found.
    $fresh = [System.IO.Path]::Combine($Sources, [guid]::NewGuid().ToString('N'))
    [void] (New-Item -ItemType Directory -Path $fresh -Force)
    $made = [System.IO.Path]::Combine($fresh, 'RarmsModel.dll')
    Add-Type -Path $files -ReferencedAssemblies $references -OutputAssembly $made -OutputType Library @more -IgnoreWarnings -WarningAction SilentlyContinue
    # Each module has the file: what is imported as one module gives another one nothing.
    foreach ($one in 'Hyper-V', 'FailoverClusters') {
        Copy-Item -LiteralPath $made -Destination ([System.IO.Path]::Combine($Modules, $one))
    }
    Move-Item -LiteralPath $made -Destination $dll
}
