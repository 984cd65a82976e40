# --- part guest: the same bytes in every script that carries it --------------------------------
# Where the script of a guest may run.

function Assert-Guest {
    # A guest's script must not run on the host itself.
    if ([Environment]::MachineName -ne $script:Definition.Computer) { return }
    Exit-Refused -Detail 'this script is for a guest, and this is its host'
}
# --- end of the part guest ---------------------------------------------------------------------
