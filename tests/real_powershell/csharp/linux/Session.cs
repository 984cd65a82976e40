// What makes a session of PowerShell for Linux one of Windows: types, provider, drives, access lists and the check of
// elevation.
using System;
using System.Collections;
using System.Collections.Generic;
using System.Globalization;
using System.IO;
using System.Management.Automation;
using System.Management.Automation.Language;
using System.Management.Automation.Runspaces;
using System.Reflection;

namespace RarmsTests
{
    public static class WindowsSession
    {
        /// <summary>Return what the model says where it refuses; else null.</summary>
        internal static string Refusal(Dictionary<string, object> answer)
        {
            object problem;
            return answer.TryGetValue("error", out problem) ? (string)((Dictionary<string, object>)problem)["message"] : null;
        }

        /// <summary>Furnish the sessions that are made from this state.</summary>
        public static InitialSessionState Furnish(InitialSessionState state)
        {
            Runner.Rename();
            Dictionary<string, Type> names = Runner.Names();
            names["System.IO.Path"] = typeof(WindowsPath);
            names["System.Security.Principal.WindowsIdentity"] = typeof(WindowsUser);
            names["System.Security.Principal.SecurityIdentifier"] = typeof(WindowsSid);
            Runner.Believe(Wire.Ask("about", true));
            // Ours come last, so that they are found before those of the same name.
            state.ImportPSModule(new[] { "Microsoft.PowerShell.Management", "Microsoft.PowerShell.Utility", "RarmsModel" });
            state.Providers.Add(new SessionStateProviderEntry("Registry", typeof(WindowsRegistry), null));
            MethodInfo fullName = typeof(WindowsPath).GetMethod("FullName");
            foreach (Type kind in new[] { typeof(FileInfo), typeof(DirectoryInfo) })
            {
                TypeData data = new TypeData(kind);
                data.Members.Add("FullName", new CodePropertyData("FullName", fullName));
                state.Types.Add(new SessionStateTypeEntry(data, false));
            }
            return state;
        }

        /// <summary>Run the console that was started in place of pwsh itself: the same, with furnished sessions.</summary>
        internal static void Start()
        {
            string[] all = Environment.GetCommandLineArgs();
            string[] words = new string[all.Length - 1];
            Array.Copy(all, 1, words, 0, words.Length);
            InitialSessionState state = Furnish(InitialSessionState.CreateDefault2());
            Environment.Exit(Microsoft.PowerShell.ConsoleShell.Start(state, "", "", words));
        }

        /// <summary>Make the drives of a session that is open.</summary>
        internal static void Open(SessionState session)
        {
            ProviderInfo files = session.Provider.GetOne("FileSystem");
            foreach (string folder in Directory.GetDirectories(WindowsPath.Drives, "drive_*"))
            {
                string letter = folder.Substring(folder.Length - 1).ToUpperInvariant();
                session.Drive.New(new PSDriveInfo(letter, files, folder, "", null), "global");
            }
            // Not by $ExecutionContext, which comes later, nor by session.InvokeCommand, which commands do not look at.
            object engine = Inner(Inner(Inner(session, "Internal"), "ExecutionContext"), "EngineIntrinsics");
            ((EngineIntrinsics)engine).InvokeCommand.PostCommandLookupAction = RequireElevation;
        }

        private static object Inner(object outer, string name)
        {
            return outer.GetType().GetProperty(name, BindingFlags.Instance | BindingFlags.NonPublic).GetValue(outer, null);
        }

        /// <summary>Refuse a script that needs an administrator: PowerShell for Linux takes everybody for one.</summary>
        private static void RequireElevation(object sender, CommandLookupEventArgs found)
        {
            ExternalScriptInfo script = found.Command as ExternalScriptInfo;
            ScriptBlockAst tree = script == null ? null : script.ScriptBlock.Ast as ScriptBlockAst;
            if (tree == null || tree.ScriptRequirements == null || !tree.ScriptRequirements.IsElevationRequired) { return; }
            if (Principal.Elevated) { return; }
            // An exception from here would be passed over.
            found.CommandScriptBlock = ScriptBlock.Create(
                "[CmdletBinding(PositionalBinding=$false)] param([Parameter(ValueFromRemainingArguments)] $Words)\n"
                + "$says = 'The script ''" + script.Name.Replace("'", "''") + "'' cannot be run because it contains a "
                + "\"#requires\" statement for running as Administrator.'\n"
                + "$PSCmdlet.ThrowTerminatingError([Management.Automation.ErrorRecord]::new("
                + "[Management.Automation.ScriptRequiresException]::new($says), 'ScriptRequiresElevation', 'PermissionDenied', $null))");
        }
    }

    /// <summary>System.Security.Principal.WindowsIdentity, which .NET for Linux refuses to make.</summary>
    public sealed class WindowsUser
    {
        public string Name { get { return Machine.MachineName + "\\" + Machine.UserName; } }

        public WindowsSid User { get { return new WindowsSid("S-1-5-21-1-2-3-1001"); } }

        public static WindowsUser GetCurrent() { return new WindowsUser(); }
    }

    /// <summary>System.Security.Principal.SecurityIdentifier.</summary>
    public sealed class WindowsSid
    {
        public WindowsSid(string value) { Value = value; }

        public string Value { get; private set; }

        public override string ToString() { return Value; }
    }

    /// <summary>What Get-Acl gives; the model keeps owner and rights.</summary>
    public sealed class WindowsAccessList
    {
        private readonly string _owner;

        internal WindowsAccessList(string owner) { _owner = owner; Sddl = "O:" + owner; }

        public string Sddl { get; private set; }

        public WindowsSid GetOwner(Type kind) { return new WindowsSid(_owner); }

        public void SetSecurityDescriptorSddlForm(string sddl) { Sddl = sddl; }

        public void SetSecurityDescriptorSddlForm(string sddl, string sections) { Sddl = sddl; }
    }

    [Cmdlet("Get", "Acl")]
    public sealed class WindowsGetAcl : ModelCmdlet
    {
        [Parameter(Mandatory = true)]
        public string LiteralPath { get; set; }

        protected override void ProcessRecord()
        {
            string owner = (string)Call("Get-Acl", Json.Table("literalpath", WindowsPath.There(LiteralPath)))[0];
            WriteObject(new WindowsAccessList(owner));
        }
    }

    [Cmdlet("Set", "Acl")]
    public sealed class WindowsSetAcl : ModelCmdlet
    {
        [Parameter(Mandatory = true)]
        public string LiteralPath { get; set; }

        [Parameter(Mandatory = true)]
        public WindowsAccessList AclObject { get; set; }

        protected override void ProcessRecord()
        {
            Call("Set-Acl", Json.Table("literalpath", WindowsPath.There(LiteralPath), "sddl", AclObject.Sddl));
        }
    }
}
