# A warm process: compiles the cmdlets where that was not done, then runs scripts that come over the socket.
param([string] $Sources, [string] $Modules)
$ErrorActionPreference = 'Stop'
& ([System.IO.Path]::Combine($PSScriptRoot, 'compile.ps1')) -Sources $Sources -Modules $Modules
$env:PSModulePath = $Modules + [System.IO.Path]::PathSeparator + [System.IO.Path]::Combine($PSHOME, 'Modules')
Add-Type -Path ([System.IO.Path]::Combine($Modules, 'RarmsModel', 'RarmsModel.dll'))
[RarmsTests.Runner]::Serve()
