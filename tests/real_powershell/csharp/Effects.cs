// What scripts call by the names of .NET: the same files, registry and event log, and the model is told of each change
// before and after it is made, so that it can kill the script there or let the call fail.
using System;
using System.Collections.Generic;
using System.IO;
using System.Management.Automation;
#if LINUX
using Directory = RarmsTests.WindowsDirectory;
using FileStream = RarmsTests.WindowsFileStream;
using Real = RarmsTests.WindowsFile;
#else
using Real = System.IO.File;
#endif

namespace RarmsTests
{
    public static class Effects
    {
        // Whether only half of what is to be written reaches the disk.
        public static bool Begin(string says)
        {
            Dictionary<string, object> answer = Wire.Ask("effect", says);
            object problem;
            if (answer.TryGetValue("error", out problem)) { throw new IOException((string)problem); }
            return answer.ContainsKey("half");
        }

        public static void End() { Wire.Ask("done", true); }

        public static void Do(string says, Action act)
        {
            Begin(says);
            act();
            End();
        }
    }

    // The model's time: it passes where scripts sleep.
    public static class Clock
    {
        public static long Milliseconds; // since the clock of the model begins
        public static DateTime Beginning;
        public static DateTime UtcNow { get { return Beginning.AddMilliseconds(Milliseconds); } }
    }

    public static class Machine
    {
        public static string MachineName { get; set; }
        public static string UserName { get; set; }
        public static string GetFolderPath(Environment.SpecialFolder folder)
        {
            if (folder == Environment.SpecialFolder.CommonApplicationData) { return "C:\\ProgramData"; }
            return Environment.GetFolderPath(folder);
        }
    }

    // The model says whether the log takes the entry; on Windows it is then written, to the log of wine.
    public static class EventLog
    {
        public static void WriteEntry(string source, string message, System.Diagnostics.EventLogEntryType type, int number)
        {
            Dictionary<string, object> answer = Wire.Ask("event", new object[] { type.ToString(), number, message });
            if (answer.ContainsKey("error")) { throw new InvalidOperationException((string)answer["error"]); }
#if !LINUX
            System.Diagnostics.EventLog.WriteEntry(source, message, type, number);
#endif
        }
    }

    public sealed class Principal
    {
        public static bool Elevated;
        public static bool HypervAdministrator;
        public Principal(object identity) { }

        public bool IsInRole(object role)
        {
            PSObject wrapped = role as PSObject;
            string asked = (wrapped == null ? role : wrapped.BaseObject).ToString();
            return asked == "S-1-5-32-578" ? HypervAdministrator : Elevated;
        }
    }

    public sealed class Stream : FileStream
    {
        static readonly List<Stream> Opened = new List<Stream>();
        readonly string path;

        public Stream(string path, FileMode mode, FileAccess access) : this(path, mode, access, FileShare.Read) { }

        // Without a buffer: what was written is in the file.
        public Stream(string path, FileMode mode, FileAccess access, FileShare share) : base(Announced(path, mode), mode, access, share, 1)
        {
            this.path = path;
            lock (Opened) { Opened.Add(this); }
            if (created) { created = false; Effects.End(); }
        }

        [ThreadStatic] static bool created;

        static string Announced(string path, FileMode mode)
        {
            created = mode != FileMode.Open && !Real.Exists(path);
            if (created) { Effects.Begin("open " + path); }
            return path;
        }

        public override void SetLength(long value)
        {
            if (value == Length) { return; }
            Effects.Do("cut " + path, delegate { base.SetLength(value); });
        }

        public override void Write(byte[] array, int offset, int count)
        {
            bool half = Effects.Begin("write " + path);
            base.Write(array, offset, half ? count / 2 : count);
            Flush(true);
            Effects.End();
        }

        protected override void Dispose(bool disposing)
        {
            lock (Opened) { Opened.Remove(this); }
            base.Dispose(disposing);
        }

        internal static void CloseAll()
        {
            lock (Opened)
            {
                foreach (Stream one in Opened) { one.SafeFileHandle.Close(); }
                Opened.Clear();
            }
        }
    }

    public static class File
    {
        public static bool Exists(string path) { return Real.Exists(path); }
        public static FileAttributes GetAttributes(string path) { return Real.GetAttributes(path); }
        public static byte[] ReadAllBytes(string path) { return Real.ReadAllBytes(path); }
        public static string ReadAllText(string path) { return Real.ReadAllText(path); }

        public static void WriteAllText(string path, string text)
        {
            Effects.Do("write " + path, delegate { Real.WriteAllText(path, text); });
        }

        public static void WriteAllBytes(string path, byte[] data)
        {
            Effects.Do("write " + path, delegate { Real.WriteAllBytes(path, data); });
        }

        public static void Move(string old, string fresh)
        {
            Effects.Do("move " + old, delegate { Real.Move(old, fresh); });
        }

        public static void Replace(string old, string fresh, string backup)
        {
            Effects.Do("replace " + fresh, delegate { Real.Replace(old, fresh, backup); });
        }

        public static void Delete(string path)
        {
            if (!Real.Exists(path)) { Real.Delete(path); return; }
            Effects.Do("delete " + path, delegate { Real.Delete(path); });
        }
    }

    public static class Folder
    {
        public static bool Exists(string path) { return Directory.Exists(path); }

        public static string[] GetDirectories(string path, string pattern) { return Directory.GetDirectories(path, pattern); }

        public static DirectoryInfo CreateDirectory(string path)
        {
            if (!Directory.Exists(path)) { Effects.Do("make folder " + path, delegate { Directory.CreateDirectory(path); }); }
            return new DirectoryInfo(path);
        }

        public static void Delete(string path) { Delete(path, false); }

        public static void Delete(string path, bool recursive)
        {
            if (recursive && Directory.Exists(path))
            {
                string[] inside = Directory.GetFileSystemEntries(path, "*", SearchOption.AllDirectories);
                Array.Sort(inside, StringComparer.OrdinalIgnoreCase);
                Array.Reverse(inside);
                foreach (string one in inside)
                {
                    Effects.Do("delete " + one, delegate { if (Directory.Exists(one)) { Directory.Delete(one); } else { Real.Delete(one); } });
                }
            }
            Effects.Do("delete " + path, delegate { Directory.Delete(path); });
        }
    }

    // The registry's cmdlets are PowerShell's own; only what they change is announced.
    static class Announced
    {
        static string Of(PSCmdlet cmdlet, string name)
        {
            object value = cmdlet.MyInvocation.BoundParameters[name];
            string[] all = value as string[];
            return all == null ? (string)value : string.Join(", ", all);
        }

        public static void Run(PSCmdlet cmdlet, bool changes, string name, string parameter, Action act)
        {
            if (!changes) { act(); return; }
            string says = name + " " + Of(cmdlet, parameter);
            if (name.EndsWith("Property", StringComparison.Ordinal)) { says += " " + Of(cmdlet, "Name"); }
            Effects.Do(says, act);
        }
    }

    [Cmdlet("New", "Item", SupportsShouldProcess = true, DefaultParameterSetName = "pathSet")]
    public sealed class NewItem : Microsoft.PowerShell.Commands.NewItemCommand
    {
        protected override void ProcessRecord()
        {
            Announced.Run(this, !SessionState.InvokeProvider.Item.Exists(Path[0], false, true), "New-Item", "Path", delegate { base.ProcessRecord(); });
        }
    }

    [Cmdlet("New", "ItemProperty", SupportsShouldProcess = true, DefaultParameterSetName = "Path")]
    public sealed class NewItemProperty : Microsoft.PowerShell.Commands.NewItemPropertyCommand
    {
        protected override void ProcessRecord()
        {
            Announced.Run(this, true, "New-ItemProperty", "LiteralPath", delegate { base.ProcessRecord(); });
        }
    }

    [Cmdlet("Remove", "ItemProperty", SupportsShouldProcess = true, DefaultParameterSetName = "Path")]
    public sealed class RemoveItemProperty : Microsoft.PowerShell.Commands.RemoveItemPropertyCommand
    {
        protected override void ProcessRecord()
        {
            Announced.Run(this, true, "Remove-ItemProperty", "LiteralPath", delegate { base.ProcessRecord(); });
        }
    }

    [Cmdlet("Remove", "Item", SupportsShouldProcess = true, DefaultParameterSetName = "Path")]
    public sealed class RemoveItem : Microsoft.PowerShell.Commands.RemoveItemCommand
    {
        protected override void ProcessRecord()
        {
            Announced.Run(this, SessionState.InvokeProvider.Item.Exists(LiteralPath[0], false, true), "Remove-Item", "LiteralPath", delegate { base.ProcessRecord(); });
        }
    }
}
