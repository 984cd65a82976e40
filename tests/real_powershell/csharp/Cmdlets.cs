// What the cmdlets share that are made from the tables, and the others around Hyper-V that the model answers.
using System;
using System.Collections;
using System.Collections.Generic;
using System.IO;
using System.Management.Automation;
using System.Security.AccessControl;
using System.Threading;

namespace RarmsTests
{
    public abstract class ModelCmdlet : PSCmdlet
    {
        static readonly HashSet<string> Common = new HashSet<string>(CommonParameters) { "WhatIf", "Confirm" };

        protected override void ProcessRecord()
        {
            string name = MyInvocation.MyCommand.Name;
            Dictionary<string, object> given = Given();
            CmdletAttribute mark = (CmdletAttribute)GetType().GetCustomAttributes(typeof(CmdletAttribute), false)[0];
            if (mark.SupportsShouldProcess && !ShouldProcess(name, name)) { return; }
            foreach (object one in Call(name, given)) { WriteObject(one); }
        }

        protected Dictionary<string, object> Given()
        {
            Dictionary<string, object> given = new Dictionary<string, object>();
            foreach (KeyValuePair<string, object> pair in MyInvocation.BoundParameters)
            {
                if (!Common.Contains(pair.Key)) { given[pair.Key.ToLowerInvariant()] = pair.Value; }
            }
            return given;
        }

        // The objects that the model answers with; an error of it ends the cmdlet.
        protected object[] Call(string name, Dictionary<string, object> given)
        {
            Dictionary<string, object> answer = Wire.Ask("cmdlet", name, "given", given);
            object found;
            if (answer.TryGetValue("error", out found)) { Throw((Dictionary<string, object>)found); }
            object[] objects = Array.ConvertAll((object[])answer["objects"], Wire.Decode);
            foreach (object one in objects)
            {
                Job job = one as Job;
                if (job != null) { JobRepository.Add(job); }
            }
            return objects;
        }

        void Throw(Dictionary<string, object> error)
        {
            ErrorCategory category;
            if (!Enum.TryParse((string)error["category"], out category)) { category = ErrorCategory.NotSpecified; }
            Exception says = new Microsoft.HyperV.PowerShell.VirtualizationException((string)error["message"]);
            ThrowTerminatingError(new ErrorRecord(says, (string)error["id"], category, null));
        }
    }

    [Cmdlet("Start", "Sleep")]
    public sealed class StartSleep : ModelCmdlet
    {
        [Parameter(Mandatory = true, ParameterSetName = "Seconds", Position = 0)]
        public double Seconds { get; set; }

        [Parameter(Mandatory = true, ParameterSetName = "Milliseconds")]
        public int Milliseconds { get; set; }

        readonly ManualResetEvent stopped = new ManualResetEvent(false);

        // Ctrl-C is heard here, and others let go of files.
        protected override void ProcessRecord()
        {
            Dictionary<string, object> answer = Wire.Ask("sleep", ParameterSetName == "Seconds" ? (long)(Seconds * 1000) : Milliseconds);
            if (answer.ContainsKey("free")) { Runner.Free(); }
            if (!answer.ContainsKey("interrupt")) { return; }
            Runner.Interrupt();
            stopped.WaitOne();
        }

        protected override void StopProcessing() { stopped.Set(); }
    }

    // What the end of a script's pipeline gets: a line as it is, anything else by its properties.
    [Cmdlet("Out", "Model")]
    public sealed class OutModel : PSCmdlet
    {
        [Parameter(ValueFromPipeline = true)]
        public PSObject InputObject { get; set; }

        protected override void ProcessRecord()
        {
            if (InputObject == null) { return; }
            object held = InputObject.BaseObject;
            ErrorRecord error = held as ErrorRecord;
            if (error != null) { Wire.Tell("line", error.ToString(), "stream", "talk"); }
            else if (held is string || held is ValueType) { Wire.Tell("line", LanguagePrimitives.ConvertTo<string>(InputObject), "stream", "out"); }
            else if (held is InformationRecord) { Wire.Tell("line", held.ToString(), "stream", "information"); }
            else if (held is WarningRecord || held is VerboseRecord) { Wire.Tell("line", held.ToString(), "stream", "talk"); }
            else { Wire.Tell("object", Json.Properties(InputObject)); }
        }
    }
}

namespace Microsoft.PowerShell.Commands
{
    using RarmsTests;

    [Cmdlet("Get", "WinEvent")]
    public sealed class GetWinEventCommand : ModelCmdlet
    {
        [Parameter(Mandatory = true)]
        public Hashtable FilterHashtable { get; set; }

        [Parameter]
        public long MaxEvents { get; set; }
    }

    [Cmdlet("Get", "ExecutionPolicy")]
    public sealed class GetExecutionPolicyCommand : ModelCmdlet
    {
        [Parameter]
        public SwitchParameter List { get; set; }
    }

#if !LINUX
    // wine makes access lists from the modes of its files, and keeps none.
    [Cmdlet("Get", "Acl")]
    public sealed class GetAclCommand : ModelCmdlet
    {
        [Parameter(Mandatory = true)]
        public string LiteralPath { get; set; }

        protected override void ProcessRecord()
        {
            string owner = (string)Call("Get-Acl", Given())[0];
            FileSystemSecurity list = Directory.Exists(LiteralPath) ? (FileSystemSecurity)new DirectorySecurity() : new FileSecurity();
            list.SetSecurityDescriptorSddlForm("O:" + owner + "D:", AccessControlSections.All);
            WriteObject(list);
        }
    }

    [Cmdlet("Set", "Acl")]
    public sealed class SetAclCommand : ModelCmdlet
    {
        [Parameter(Mandatory = true)]
        public string LiteralPath { get; set; }

        [Parameter(Mandatory = true)]
        public FileSystemSecurity AclObject { get; set; }

        protected override void ProcessRecord()
        {
            const AccessControlSections all = AccessControlSections.Owner | AccessControlSections.Group | AccessControlSections.Access;
            Dictionary<string, object> given = Json.Table("literalpath", LiteralPath);
            given["sddl"] = AclObject.GetSecurityDescriptorSddlForm(all);
            Call("Set-Acl", given);
        }
    }
#endif
}

namespace Microsoft.Management.Infrastructure.CimCmdlets
{
    using RarmsTests;

    [Cmdlet("Get", "CimInstance")]
    public sealed class GetCimInstanceCommand : ModelCmdlet
    {
        [Parameter]
        public string Namespace { get; set; }

        [Parameter(Mandatory = true)]
        public string ClassName { get; set; }
    }
}
