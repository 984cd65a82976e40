#Requires -Version 5.1
# rarms: with `connect: { receiver: installed }`, rarms starts this file on a host where the module Rarms is installed. It is
# in the folder ...\Modules\Rarms, above the folders of the versions. It receives scripts with the version that rarms asks
# for. If that version is missing, it lists the installed versions and receives nothing.
[CmdletBinding(PositionalBinding = $false)]
param([string] $Version = '')
if ([string] $ExecutionContext.SessionState.LanguageMode -cne 'FullLanguage') { throw 'App Control: allow this script by its signer' }
$PSDefaultParameterValues = @{}
$ErrorActionPreference = 'Stop'
$ProgressPreference = 'SilentlyContinue'
Set-StrictMode -Version 3.0
$file = [System.IO.Path]::Combine($PSScriptRoot, $Version, 'Rarms.psm1')
if (-not (Microsoft.PowerShell.Management\Test-Path -LiteralPath $file)) {
    $folders = @(Microsoft.PowerShell.Management\Get-ChildItem -LiteralPath $PSScriptRoot -Directory)
    $names = @(foreach ($one in $folders) { $one.Name })
    [Console]::Out.WriteLine('rarms-receiver/1 has ' + ($names -join ' '))
    exit 90
}
$rarms = Import-Module -Name ([WildcardPattern]::Escape($file)) -Force -PassThru -Function 'Receive-RarmsPlan'
$invoke = $rarms.ExportedFunctions['Receive-RarmsPlan']
$source = [Console]::OpenStandardInput()
[Console]::Out.WriteLine('rarms-receiver/1 ready ' + $Version)
exit (& $invoke -Source $source)
