// A PowerShell that the tests did not start, such as that of rarms: .NET calls this before its program begins, where
// DOTNET_STARTUP_HOOKS names the file. Cmdlets come by PSModulePath. On Linux `linux/Session.cs` goes on.
using System;
using System.Collections.Generic;
using System.Globalization;
using System.Management.Automation;
using RarmsTests;

public static class StartupHook
{
    internal static bool Called;

    public static void Initialize()
    {
#if LINUX
        WindowsSession.Start();
#else
        Called = true;
        Dictionary<string, object> about = Wire.Ask("about", true);
        Machine.MachineName = Environment.MachineName;
        Machine.UserName = Environment.UserName;
        Principal.Elevated = (bool)about["elevated"];
        Principal.HypervAdministrator = (bool)about["hyperv_administrator"];
        Clock.Beginning = DateTime.Parse((string)about["beginning"], CultureInfo.InvariantCulture, DateTimeStyles.AdjustToUniversal);
        Runner.Rename();
#endif
    }
}

namespace RarmsTests
{
    // In such a process a module of PowerShell that is loaded later would hide ours: aliases come before cmdlets.
    public sealed class Aliases : IModuleAssemblyInitializer
    {
        static readonly string[] Names =
        {
            "Start-Sleep", "Get-Acl", "Set-Acl", "New-Item", "New-ItemProperty", "Remove-Item", "Remove-ItemProperty",
        };

        public void OnImport()
        {
            if (!StartupHook.Called) { return; }
            foreach (string name in Names)
            {
                using (PowerShell shell = PowerShell.Create(RunspaceMode.CurrentRunspace))
                {
                    shell.AddCommand("Set-Alias").AddParameter("Name", name).AddParameter("Value", "RarmsModel\\" + name);
                    shell.AddParameter("Scope", "Global").Invoke();
                }
            }
        }
    }
}
