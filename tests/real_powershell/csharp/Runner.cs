// A process that runs one script after another, each in a runspace of its own, as `-File` does.
using System;
using System.Collections;
using System.Collections.Generic;
using System.Collections.ObjectModel;
using System.Diagnostics;
using System.Globalization;
using System.IO;
using System.Management.Automation;
using System.Management.Automation.Host;
using System.Management.Automation.Runspaces;
using System.Reflection;
using System.Security;
using System.Threading;

namespace RarmsTests
{
    public static class Runner
    {
        static Pipeline running;
        static readonly List<FileStream> held = new List<FileStream>();

        public static void Serve()
        {
            Rename();
            Wire.Tell("runner", Process.GetCurrentProcess().Id);
            string line;
            while ((line = Wire.Receive()) != null)
            {
                try
                {
                    Dictionary<string, object> order = (Dictionary<string, object>)Json.Read(line);
                    if (order.ContainsKey("script")) { Run(order); }
                    else { Wire.Tell("exit", 0, "registry", Registry.Read(order)); } // what a process that died has left
                }
                catch (Exception error) { Wire.Tell("broken", error.ToString()); }
            }
            Process.GetCurrentProcess().Kill(); // threads of killed scripts would keep it alive
        }

        // What scripts call by these names of .NET is ours: only the parser's own table comes before .NET's types.
        public static void Rename()
        {
            Dictionary<string, Type> names = Names();
            names["DateTime"] = typeof(Clock);
            names["Environment"] = typeof(Machine);
            names["System.Diagnostics.Stopwatch"] = typeof(Watch);
            names["System.IO.File"] = typeof(File);
            names["System.IO.Directory"] = typeof(Folder);
            names["System.IO.FileStream"] = typeof(Stream);
            names["System.Diagnostics.EventLog"] = typeof(EventLog);
            names["System.Security.Principal.WindowsPrincipal"] = typeof(Principal);
        }

        internal static Dictionary<string, Type> Names()
        {
            Type table = typeof(PSObject).Assembly.GetType("System.Management.Automation.TypeAccelerators");
            FieldInfo field = table.GetField("builtinTypeAccelerators", BindingFlags.NonPublic | BindingFlags.Static);
            return (Dictionary<string, Type>)field.GetValue(null);
        }

        public static void Interrupt()
        {
            running.StopAsync();
        }

        // Whoever has files open beside the script closes them.
        public static void Free()
        {
            foreach (FileStream one in held) { one.Dispose(); }
            held.Clear();
        }

        static string[] Words(object list)
        {
            return Array.ConvertAll((object[])list, delegate(object one) { return (string)one; });
        }

        static void Take(Dictionary<string, object> order)
        {
            foreach (KeyValuePair<string, object> one in (Dictionary<string, object>)order["environment"])
            {
                Environment.SetEnvironmentVariable(one.Key, (string)one.Value);
            }
            Believe(order);
            Wire.Parks = (bool)order["parks"];
            Wire.Killed.Reset();
        }

        // Facts of the host that do not change while a script runs, and the time there.
        internal static void Believe(Dictionary<string, object> order)
        {
            Machine.MachineName = (string)order["computer"];
            Machine.UserName = (string)order["user"];
            Principal.Elevated = (bool)order["elevated"];
            Principal.HypervAdministrator = (bool)order["hyperv_administrator"];
            Clock.Beginning = DateTime.Parse((string)order["beginning"], CultureInfo.InvariantCulture, DateTimeStyles.AdjustToUniversal);
            Clock.Milliseconds = (long)order["now"];
        }

        static Runspace Open(Dictionary<string, object> order, PSHost host)
        {
            InitialSessionState state = InitialSessionState.CreateDefault2();
            state.ExecutionPolicy = Microsoft.PowerShell.ExecutionPolicy.Bypass;
            // Ours come last, so that they are found before those of the same name.
            state.ImportPSModule(Words(order["modules"]));
            Runspace runspace = RunspaceFactory.CreateRunspace(host, state);
            runspace.Open();
            return runspace;
        }

        static void Run(Dictionary<string, object> order)
        {
            Stopwatch watch = Stopwatch.StartNew();
            Take(order);
            Hold((object[])order["held"]);
            Registry.Lay(order);
            ModelHost host = new ModelHost();
            Runspace runspace = Open(order, host);
            double opened = watch.Elapsed.TotalMilliseconds;
            foreach (string line in Words(order["first"]))
            {
                using (Pipeline first = runspace.CreatePipeline())
                {
                    first.Commands.Add(new Command(line, true, false)); // in the global scope, as a profile
                    first.Invoke();
                }
            }
            Pipeline pipeline = runspace.CreatePipeline();
            Command script = Script(order);
            script.MergeMyResults(PipelineResultTypes.Error, PipelineResultTypes.Output);
            pipeline.Commands.Add(script);
            pipeline.Commands.Add(new Command("Out-Model"));
            if ((string)order["form"] == "file") { LetExitEnd(runspace); }
            running = pipeline;
            bool whole = Wait(pipeline);
            if (whole)
            {
                int code = Code(runspace, pipeline, host, (string)order["form"] == "file");
                Free();
                runspace.Dispose();
                Wire.Tell("exit", code, "opened", opened, "ms", watch.Elapsed.TotalMilliseconds, "registry", Registry.Read(order));
                return;
            }
            Free();
            Wire.Tell("killed", true, "registry", Registry.Read(order)); // its thread and runspace stay behind
        }

        // `exit` of this script ends the host, as the console has it for -File; that of scripts that it calls does not.
        static void LetExitEnd(Runspace runspace)
        {
            const BindingFlags inner = BindingFlags.NonPublic | BindingFlags.Instance;
            object context = typeof(Runspace).GetProperty("ExecutionContext", inner).GetValue(runspace, null);
            context.GetType().GetProperty("ScriptCommandProcessorShouldRethrowExit", inner).SetValue(context, true, null);
        }

        // In the global scope, as -File runs it; by & or . as at a prompt.
        static Command Script(Dictionary<string, object> order)
        {
            string form = (string)order["form"], path = (string)order["script"];
            if (form != "file")
            {
                string text = form + " '" + path.Replace("'", "''") + "' " + string.Join(" ", Words(order["arguments"]));
                return new Command(text, true, false);
            }
            Command script = new Command(path, false, false);
            foreach (string word in Words(order["arguments"]))
            {
                bool named = word.StartsWith("-", StringComparison.Ordinal);
                script.Parameters.Add(named ? new CommandParameter(word) : new CommandParameter(null, word));
            }
            return script;
        }

        static bool Wait(Pipeline pipeline)
        {
            ManualResetEvent ended = new ManualResetEvent(false);
            pipeline.StateChanged += delegate(object sender, PipelineStateEventArgs e)
            {
                PipelineState now = e.PipelineStateInfo.State;
                if (now == PipelineState.Completed || now == PipelineState.Failed || now == PipelineState.Stopped) { ended.Set(); }
            };
            pipeline.InvokeAsync();
            pipeline.Input.Close();
            return WaitHandle.WaitAny(new WaitHandle[] { ended, Wire.Killed }) == 0;
        }

        static int Code(Runspace runspace, Pipeline pipeline, ModelHost host, bool isFile)
        {
            if (pipeline.PipelineStateInfo.State == PipelineState.Stopped) { return 0; } // Ctrl-C
            if (host.Code != null) { return host.Code.Value; }
            if (pipeline.PipelineStateInfo.Reason != null)
            {
                Wire.Tell("line", pipeline.PipelineStateInfo.Reason.Message, "stream", "talk");
                return 1;
            }
            if (isFile) { return 0; } // what a script that it called ended with is nothing to -File
            object last = runspace.SessionStateProxy.GetVariable("LASTEXITCODE");
            return last == null ? 0 : (int)LanguagePrimitives.ConvertTo(last, typeof(int), CultureInfo.InvariantCulture);
        }

        // What another process has open while the script runs.
        static void Hold(object[] files)
        {
            foreach (object[] one in files)
            {
                FileAccess access = (FileAccess)Enum.Parse(typeof(FileAccess), (string)one[1]);
                FileShare share = (FileShare)Enum.Parse(typeof(FileShare), (string)one[2]);
                held.Add(new FileStream((string)one[0], FileMode.Open, access, share));
            }
        }
    }

    // The keys of the model's registry: the trees are its own, of other keys only some values.
    static class Registry
    {
        static Microsoft.Win32.RegistryKey Root { get { return Microsoft.Win32.Registry.LocalMachine; } }

        public static void Lay(Dictionary<string, object> order)
        {
            foreach (object path in (object[])order["trees"]) { Root.DeleteSubKeyTree((string)path, false); }
            foreach (KeyValuePair<string, object> pair in (Dictionary<string, object>)order["values"])
            {
                using (Microsoft.Win32.RegistryKey key = Root.CreateSubKey(pair.Key))
                {
                    foreach (object name in (object[])pair.Value) { key.DeleteValue((string)name, false); }
                }
            }
            foreach (KeyValuePair<string, object> pair in (Dictionary<string, object>)order["registry"])
            {
                using (Microsoft.Win32.RegistryKey key = Root.CreateSubKey(pair.Key))
                {
                    foreach (object[] value in (object[])pair.Value) { Write(key, value); }
                }
            }
        }

        static void Write(Microsoft.Win32.RegistryKey key, object[] value)
        {
            string name = (string)value[0], kind = (string)value[1];
            object data = value[2];
            if (kind == "DWord") { data = unchecked((int)(long)data); }
            if (kind == "Binary")
            {
                string[] words = ((string)data).Split(new[] { ' ' }, StringSplitOptions.RemoveEmptyEntries);
                data = Array.ConvertAll(words, delegate(string word) { return byte.Parse(word, CultureInfo.InvariantCulture); });
            }
            key.SetValue(name, data, (Microsoft.Win32.RegistryValueKind)Enum.Parse(typeof(Microsoft.Win32.RegistryValueKind), kind));
        }

        public static Dictionary<string, object> Read(Dictionary<string, object> order)
        {
            Dictionary<string, object> found = new Dictionary<string, object>();
            foreach (object path in (object[])order["trees"]) { ReadTree((string)path, found); }
            foreach (KeyValuePair<string, object> pair in (Dictionary<string, object>)order["values"])
            {
                using (Microsoft.Win32.RegistryKey key = Root.OpenSubKey(pair.Key))
                {
                    if (key != null) { found[pair.Key] = Values(key, new List<object>((object[])pair.Value)); }
                }
            }
            return found;
        }

        static void ReadTree(string path, Dictionary<string, object> found)
        {
            using (Microsoft.Win32.RegistryKey key = Root.OpenSubKey(path))
            {
                if (key == null) { return; }
                found[path] = Values(key, null);
                foreach (string name in key.GetSubKeyNames()) { ReadTree(path + "\\" + name, found); }
            }
        }

        static List<object> Values(Microsoft.Win32.RegistryKey key, List<object> only)
        {
            List<object> values = new List<object>();
            foreach (string name in key.GetValueNames())
            {
                if (only != null && !only.Contains(name)) { continue; }
                object data = key.GetValue(name, null, Microsoft.Win32.RegistryValueOptions.DoNotExpandEnvironmentNames);
                if (data is int) { data = (long)unchecked((uint)(int)data); }
                byte[] bytes = data as byte[];
                if (bytes != null) { data = string.Join(" ", bytes); }
                values.Add(new object[] { name, key.GetValueKind(name).ToString(), data });
            }
            return values;
        }
    }

    sealed class ModelHost : PSHost
    {
        readonly Guid id = Guid.NewGuid();
        readonly ModelUi ui = new ModelUi();
        public int? Code;
        public override CultureInfo CurrentCulture { get { return CultureInfo.InvariantCulture; } }
        public override CultureInfo CurrentUICulture { get { return CultureInfo.InvariantCulture; } }
        public override Guid InstanceId { get { return id; } }
        public override string Name { get { return "ConsoleHost"; } }
        public override PSHostUserInterface UI { get { return ui; } }
        public override Version Version { get { return new Version(1, 0); } }
        public override void EnterNestedPrompt() { throw new NotSupportedException(); }
        public override void ExitNestedPrompt() { }
        public override void NotifyBeginApplication() { }
        public override void NotifyEndApplication() { }
        public override void SetShouldExit(int exitCode) { Code = exitCode; }
    }

    sealed class ModelUi : PSHostUserInterface
    {
        readonly ModelRaw raw = new ModelRaw();
        string begun = "";
        public override PSHostRawUserInterface RawUI { get { return raw; } }

        void Say(string stream, string text)
        {
            Wire.Tell("line", begun + text, "stream", stream);
            begun = "";
        }

        public override void Write(string value) { begun += value; }
        public override void Write(ConsoleColor foreground, ConsoleColor background, string value) { begun += value; }
        public override void WriteLine(string value) { Say("out", value); }
        public override void WriteErrorLine(string value) { Say("talk", value); }
        public override void WriteDebugLine(string message) { Say("talk", message); }
        public override void WriteVerboseLine(string message) { Say("out", "VERBOSE: " + message); }
        public override void WriteWarningLine(string message) { Say("talk", message); }
        public override void WriteInformation(InformationRecord record) { Wire.Tell("line", record.ToString(), "stream", "information"); }

        public override void WriteProgress(long sourceId, ProgressRecord record)
        {
            bool gone = record.RecordType == ProgressRecordType.Completed;
            Wire.Tell("progress", gone ? "" : record.StatusDescription, "percent", gone ? -1 : record.PercentComplete);
        }

        public override int PromptForChoice(string caption, string message, Collection<ChoiceDescription> choices, int defaultChoice)
        {
            object answer = Wire.Ask("prompt", message)["answer"];
            if (answer == null) { throw new PSInvalidOperationException("no console answers here"); }
            return (int)(long)answer;
        }

        public override string ReadLine() { throw new NotSupportedException(); }
        public override SecureString ReadLineAsSecureString() { throw new NotSupportedException(); }
        public override Dictionary<string, PSObject> Prompt(string caption, string message, Collection<FieldDescription> descriptions) { throw new NotSupportedException(); }
        public override PSCredential PromptForCredential(string caption, string message, string userName, string targetName) { throw new NotSupportedException(); }
        public override PSCredential PromptForCredential(string caption, string message, string userName, string targetName, PSCredentialTypes types, PSCredentialUIOptions options) { throw new NotSupportedException(); }
    }

    sealed class ModelRaw : PSHostRawUserInterface
    {
        Size size = new Size(4000, 50);
        public override ConsoleColor BackgroundColor { get; set; }
        public override Size BufferSize { get { return size; } set { } }
        public override Coordinates CursorPosition { get; set; }
        public override int CursorSize { get; set; }
        public override ConsoleColor ForegroundColor { get; set; }
        public override bool KeyAvailable { get { return false; } }
        public override Size MaxPhysicalWindowSize { get { return size; } }
        public override Size MaxWindowSize { get { return size; } }
        public override Coordinates WindowPosition { get; set; }
        public override Size WindowSize { get { return size; } set { } }
        public override string WindowTitle { get; set; }
        public override void FlushInputBuffer() { }
        public override BufferCell[,] GetBufferContents(Rectangle rectangle) { throw new NotSupportedException(); }
        public override KeyInfo ReadKey(ReadKeyOptions options) { throw new NotSupportedException(); }
        public override void ScrollBufferContents(Rectangle source, Coordinates destination, Rectangle clip, BufferCell fill) { }
        public override void SetBufferContents(Coordinates origin, BufferCell[,] contents) { }
        public override void SetBufferContents(Rectangle rectangle, BufferCell fill) { }
    }
}
