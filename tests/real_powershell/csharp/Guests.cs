// PowerShell Direct: sessions into the model's guests, and what runs there, as far as the model lets time pass.
using System;
using System.Diagnostics;
using System.Management.Automation;

namespace RarmsTests
{
    public sealed class GuestSession : LiveObject { }

    public sealed class GuestJob : LiveObject { }

    // The model's time, which passes where scripts sleep.
    public sealed class Watch
    {
        readonly long begun = Clock.Milliseconds;
        public static Watch StartNew() { return new Watch(); }
        public long ElapsedMilliseconds { get { return Clock.Milliseconds - begun; } }
    }

    [Cmdlet("New", "PSSession")]
    public sealed class NewPSSession : ModelCmdlet
    {
        [Parameter(Mandatory = true)]
        public Guid VMId { get; set; }

        [Parameter(Mandatory = true)]
        public PSCredential Credential { get; set; }
    }

    [Cmdlet("Remove", "PSSession")]
    public sealed class RemovePSSession : ModelCmdlet
    {
        [Parameter(Mandatory = true)]
        public GuestSession Session { get; set; }
    }

    [Cmdlet("Invoke", "Command")]
    public sealed class InvokeCommand : ModelCmdlet
    {
        [Parameter(Mandatory = true)]
        public GuestSession Session { get; set; }

        [Parameter(Mandatory = true)]
        public ScriptBlock ScriptBlock { get; set; }

        [Parameter(Mandatory = true)]
        public string ArgumentList { get; set; }

        [Parameter(Mandatory = true)]
        public SwitchParameter AsJob { get; set; }
    }

    // Jobs of guests are the model's; those of Stop-VM and Start-Job are PowerShell's own.
    public abstract class JobCmdlet : ModelCmdlet
    {
        [Parameter(Mandatory = true, ValueFromPipeline = true)]
        public PSObject Job { get; set; }

        protected override void ProcessRecord()
        {
            Job own = Job.BaseObject as Job;
            if (own == null) { base.ProcessRecord(); } else { Take(own); }
        }

        protected abstract void Take(Job job);
    }

    [Cmdlet("Receive", "Job")]
    public sealed class ReceiveJob : JobCmdlet
    {
        protected override void Take(Job job)
        {
            foreach (Job child in job.ChildJobs) { Take(child); }
            foreach (PSObject one in job.Output.ReadAll()) { WriteObject(one); }
            foreach (ErrorRecord one in job.Error.ReadAll()) { WriteError(one); }
        }
    }

    [Cmdlet("Remove", "Job")]
    public sealed class RemoveJob : JobCmdlet
    {
        [Parameter]
        public SwitchParameter Force { get; set; }

        protected override void Take(Job job)
        {
            JobRepository.Remove(job);
            job.Dispose();
        }
    }
}
