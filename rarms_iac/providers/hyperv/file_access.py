"""The access lists of files and folders on Windows."""

import sys

ADMINISTRATORS_ONLY = "O:BAG:SYD:P(A;OICI;FA;;;BA)(A;OICI;FA;;;SY)"
"""As `templates/powershell/Rarms/Rarms.psm1` has it."""

OURS_ONLY = "D:P(A;OICI;FA;;;OW)(A;OICI;FA;;;BA)(A;OICI;FA;;;SY)"
"""Only the owner, Administrators and SYSTEM, at any place that `TEMP` names."""


def protect(path: str, descriptor: str) -> None:
    """Give a file or folder this owner and access list, and no inherited ones; Linux has other means.

    Args:
        path: of what is there already.
        descriptor: as SDDL; without `O:` its owner stays.
    """
    if sys.platform == "win32":
        import win32security

        wanted = win32security.ConvertStringSecurityDescriptorToSecurityDescriptor(
            descriptor, win32security.SDDL_REVISION_1
        )
        owner, flags = wanted.GetSecurityDescriptorOwner(), win32security.DACL_SECURITY_INFORMATION
        flags |= win32security.PROTECTED_DACL_SECURITY_INFORMATION
        flags |= win32security.OWNER_SECURITY_INFORMATION if owner else 0
        access = wanted.GetSecurityDescriptorDacl()
        win32security.SetNamedSecurityInfo(path, win32security.SE_FILE_OBJECT, flags, owner, None, access, None)
