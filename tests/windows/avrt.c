/* An avrt.dll for the tests: as wine's own, but it knows no other class than the robotic ones, refuses a thread that has
   one already, and answers to the name Error<number> with that error. Built by scripts/windows-python. */
#include <windows.h>
#include <wchar.h>

static __thread int joined;

__declspec(dllexport) HANDLE WINAPI AvSetMmThreadCharacteristicsW(const wchar_t *name, DWORD *index)
{
    const wchar_t *known[] = {L"SpeechRecognition", L"ObjectIdentification"};
    DWORD error = 1550;
    if (wcsncmp(name, L"Error", 5) == 0) error = wcstoul(name + 5, NULL, 10);
    for (int at = 0; at < 2; at++)
        if (_wcsicmp(name, known[at]) == 0) error = 0;
    if (*index != 0) error = 1551;
    if (joined) error = 1552;
    if (error != 0) {
        SetLastError(error);
        return NULL;
    }
    joined = 1;
    *index = 7;
    return (HANDLE)&joined;
}

__declspec(dllexport) BOOL WINAPI AvRevertMmThreadCharacteristics(HANDLE task)
{
    if (task != (HANDLE)&joined || !joined) {
        SetLastError(6);
        return FALSE;
    }
    joined = 0;
    return TRUE;
}
