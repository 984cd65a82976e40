@{
    RootModule           = 'Rarms.psm1'
    ModuleVersion        = '0.1.0'
    GUID                 = '8c1f6d52-7d0b-4b8e-9f6c-52a1d0c9e7a4'
    Author               = 'rarms'
    Description          = 'Runs plans of rarms. Each script of a plan calls this module.'
    PowerShellVersion    = '5.1'
    CompatiblePSEditions = @('Desktop', 'Core')
    FunctionsToExport    = @(
        'Invoke-RarmsPlan', 'Test-RarmsPlan', 'Get-RarmsRun', 'Undo-RarmsRun', 'Stop-RarmsRun', 'Close-RarmsRun'
        'Get-RarmsObservation', 'Receive-RarmsPlan'
    )
    CmdletsToExport      = @()
    VariablesToExport    = @()
    AliasesToExport      = @()
}
