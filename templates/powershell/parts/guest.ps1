# --- part guest: the same bytes in every script that carries it --------------------------------
# Where the script of a guest may run.

function Assert-Guest {
    # A guest's script must not run on the host itself, nor where the registry is another one.
    if ([IntPtr]::Size -ne 8) { Exit-Refused -Detail 'this PowerShell has 32 bits: start the one that has 64' }
    if ([Environment]::MachineName -ne $script:Definition.Computer) { return }
    Exit-Refused -Detail 'this script is for a guest, and this is its host'
}
# --- end of the part guest ---------------------------------------------------------------------
