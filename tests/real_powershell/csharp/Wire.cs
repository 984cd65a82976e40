// What all of it shares: lines of JSON to the model and back, and objects that follow the model.
// C# 5, so that Windows PowerShell 5.1 compiles it, too.
using System;
using System.Collections;
using System.Collections.Generic;
using System.Diagnostics;
using System.Globalization;
using System.IO;
using System.Management.Automation;
using System.Net.Sockets;
using System.Text;
using System.Threading;

namespace RarmsTests
{
    // Whole numbers are 64 bits wide unless a table says otherwise: { "$int": 3 }. No class of .NET serves 5.1 and 7.
    public static class Json
    {
        public static string Write(object value)
        {
            StringBuilder text = new StringBuilder();
            Write(text, value);
            return text.ToString();
        }

        static void Write(StringBuilder text, object value)
        {
            PSObject wrapped = value as PSObject;
            if (wrapped != null)
            {
                if (wrapped.BaseObject is PSCustomObject) { WriteTable(text, Properties(wrapped)); return; }
                value = wrapped.BaseObject;
            }
            if (value == null) { text.Append("null"); return; }
            LiveObject live = value as LiveObject;
            PSCredential credential = value as PSCredential;
            if (live != null) { WriteTable(text, Table("$key", live.Key)); }
            else if (credential != null)
            {
                WriteTable(text, Table("UserName", credential.UserName, "Secret", credential.GetNetworkCredential().Password));
            }
            else if (value is bool) { text.Append((bool)value ? "true" : "false"); }
            else if (value is SwitchParameter) { text.Append(((SwitchParameter)value).ToBool() ? "true" : "false"); }
            else if (value is string || value is char || value is Enum) { Quote(text, value.ToString()); }
            else if (value is IDictionary) { WriteTable(text, (IDictionary)value); }
            else if (value is IEnumerable)
            {
                text.Append('[');
                bool first = true;
                foreach (object one in (IEnumerable)value)
                {
                    if (!first) { text.Append(','); }
                    first = false;
                    Write(text, one);
                }
                text.Append(']');
            }
            else if (value is IConvertible && !(value is DateTime))
            {
                text.Append(Convert.ToString(value, CultureInfo.InvariantCulture));
            }
            else { Quote(text, value.ToString()); }
        }

        public static Dictionary<string, object> Table(params object[] pairs)
        {
            Dictionary<string, object> table = new Dictionary<string, object>(StringComparer.Ordinal);
            for (int at = 0; at < pairs.Length; at += 2) { table[(string)pairs[at]] = pairs[at + 1]; }
            return table;
        }

        public static Dictionary<string, object> Properties(PSObject of)
        {
            Dictionary<string, object> table = new Dictionary<string, object>(StringComparer.Ordinal);
            foreach (PSPropertyInfo one in of.Properties) { table[one.Name] = one.Value; }
            return table;
        }

        static void WriteTable(StringBuilder text, IDictionary table)
        {
            text.Append('{');
            bool first = true;
            foreach (DictionaryEntry entry in table)
            {
                if (!first) { text.Append(','); }
                first = false;
                Quote(text, entry.Key.ToString());
                text.Append(':');
                Write(text, entry.Value);
            }
            text.Append('}');
        }

        static void Quote(StringBuilder text, string value)
        {
            text.Append('"');
            foreach (char c in value)
            {
                if (c == '"' || c == '\\') { text.Append('\\').Append(c); }
                else if (c < ' ' || c > '~') { text.Append("\\u").Append(((int)c).ToString("x4", CultureInfo.InvariantCulture)); }
                else { text.Append(c); }
            }
            text.Append('"');
        }

        public static object Read(string text)
        {
            int at = 0;
            return Read(text, ref at);
        }

        // As Python writes it: no blanks but after a comma or colon.
        static object Read(string text, ref int at)
        {
            while (text[at] == ' ') { at++; }
            switch (text[at])
            {
                case '"': return Unquote(text, ref at);
                case '[': return ReadList(text, ref at);
                case '{': return ReadTable(text, ref at);
            }
            int start = at;
            while (at < text.Length && text[at] != ',' && text[at] != ']' && text[at] != '}') { at++; }
            string word = text.Substring(start, at - start);
            if (word == "null") { return null; }
            if (word == "true") { return true; }
            if (word == "false") { return false; }
            long whole;
            if (long.TryParse(word, NumberStyles.AllowLeadingSign, CultureInfo.InvariantCulture, out whole)) { return whole; }
            return double.Parse(word, CultureInfo.InvariantCulture);
        }

        static object[] ReadList(string text, ref int at)
        {
            List<object> list = new List<object>();
            for (at++; text[at] != ']';)
            {
                list.Add(Read(text, ref at));
                if (text[at] == ',') { at++; }
            }
            at++;
            return list.ToArray();
        }

        static Dictionary<string, object> ReadTable(string text, ref int at)
        {
            Dictionary<string, object> table = new Dictionary<string, object>(StringComparer.Ordinal);
            for (at++; text[at] != '}';)
            {
                while (text[at] == ' ') { at++; }
                string name = Unquote(text, ref at);
                at++; // the colon
                table[name] = Read(text, ref at);
                if (text[at] == ',') { at++; }
            }
            at++;
            return table;
        }

        static string Unquote(string text, ref int at)
        {
            StringBuilder found = new StringBuilder();
            for (at++; text[at] != '"'; at++)
            {
                if (text[at] != '\\') { found.Append(text[at]); continue; }
                at++;
                switch (text[at])
                {
                    case 'u':
                        found.Append((char)int.Parse(text.Substring(at + 1, 4), NumberStyles.HexNumber, CultureInfo.InvariantCulture));
                        at += 4;
                        break;
                    case 'n': found.Append('\n'); break;
                    case 'r': found.Append('\r'); break;
                    case 't': found.Append('\t'); break;
                    case 'b': found.Append('\b'); break;
                    case 'f': found.Append('\f'); break;
                    default: found.Append(text[at]); break;
                }
            }
            at++;
            return found.ToString();
        }
    }

    // The connection to the model: one for each process. What a script prints and what it asks come in their order.
    public static class Wire
    {
        static readonly object Turn = new object();
        static StreamReader reader;
        static StreamWriter writer;

        public static int Version; // grows with each answer: what an object said before is asked again
        public static bool Parks; // a kill leaves this process alive
        public static readonly ManualResetEvent Killed = new ManualResetEvent(false);

        static void Connect()
        {
            if (writer != null) { return; }
            int port = int.Parse(Environment.GetEnvironmentVariable("RARMS_TEST_MODEL"), CultureInfo.InvariantCulture);
            TcpClient client = new TcpClient("127.0.0.1", port);
            client.NoDelay = true;
            reader = new StreamReader(client.GetStream(), new UTF8Encoding(false));
            writer = new StreamWriter(client.GetStream(), new UTF8Encoding(false));
            writer.NewLine = "\n";
        }

        public static string Receive() { return reader.ReadLine(); }

        public static void Tell(params object[] pairs)
        {
            lock (Turn)
            {
                Connect();
                writer.WriteLine(Json.Write(Json.Table(pairs)));
                writer.Flush();
            }
        }

        // Asks the model. It may answer that this process is killed just now.
        public static Dictionary<string, object> Ask(params object[] pairs)
        {
            string line;
            lock (Turn)
            {
                Connect();
                writer.WriteLine(Json.Write(Json.Table(pairs)));
                writer.Flush();
                line = reader.ReadLine();
            }
            if (line == null) { Process.GetCurrentProcess().Kill(); }
            Dictionary<string, object> answer = (Dictionary<string, object>)Json.Read(line);
            if (answer.ContainsKey("kill")) { Die(); }
            if ((string)pairs[0] != "read") { Version++; }
            object now;
            if (answer.TryGetValue("now", out now)) { Clock.Milliseconds = (long)now; }
            return answer;
        }

        // As SIGKILL: nothing of the script runs any more. Parked, its thread sleeps for ever, and the files that it had
        // open are closed, as Windows closes them.
        public static void Die()
        {
            if (!Parks) { Process.GetCurrentProcess().Kill(); }
            Stream.CloseAll();
            Killed.Set();
            Thread.Sleep(Timeout.Infinite);
        }

        public static object Decode(object value)
        {
            object[] list = value as object[];
            if (list != null) { return Array.ConvertAll(list, Decode); }
            Dictionary<string, object> table = value as Dictionary<string, object>;
            if (table == null) { return value; }
            object found;
            if (table.TryGetValue("$int", out found)) { return (int)(long)found; }
            if (table.TryGetValue("$guid", out found)) { return new Guid((string)found); }
            if (table.TryGetValue("$live", out found)) { return LiveObject.Make(found, table); }
            PSObject plain = new PSObject();
            foreach (KeyValuePair<string, object> pair in (Dictionary<string, object>)table["$object"])
            {
                plain.Properties.Add(new PSNoteProperty(pair.Key, Decode(pair.Value)));
            }
            return plain;
        }
    }

    // An object of Hyper-V: its properties are the model's, and are asked again at the first look after any other call.
    public abstract class LiveObject
    {
        internal object Key;
        Dictionary<string, object> values;
        int version;

        internal static object Make(object key, Dictionary<string, object> table)
        {
            Type type = typeof(LiveObject).Assembly.GetType((string)table["type"], true);
            if (typeof(Job).IsAssignableFrom(type)) { return Activator.CreateInstance(type, key, table["values"]); }
            LiveObject live = (LiveObject)Activator.CreateInstance(type);
            live.Key = key;
            live.Take((Dictionary<string, object>)table["values"]);
            PSObject made = new PSObject(live);
            foreach (string name in live.values.Keys) { made.Properties.Add(new LiveProperty(name, live)); }
            return made;
        }

        void Take(Dictionary<string, object> given)
        {
            values = given;
            version = Wire.Version;
        }

        internal object Get(string name)
        {
            if (version != Wire.Version) { Take((Dictionary<string, object>)Wire.Ask("read", Key)["values"]); }
            object value;
            values.TryGetValue(name, out value);
            return Wire.Decode(value);
        }

        public override string ToString() { return GetType().FullName; }
    }

    sealed class LiveProperty : PSNoteProperty
    {
        readonly LiveObject of;
        public LiveProperty(string name, LiveObject of) : base(name, null) { this.of = of; }
        public override object Value { get { return of.Get(Name); } set { throw new NotSupportedException(); } }
        public override PSMemberInfo Copy() { return new LiveProperty(Name, of); }
    }
}

namespace Microsoft.HyperV.PowerShell
{
    using RarmsTests;

    public class VirtualizationException : Exception
    {
        public VirtualizationException(string message) : base(message) { }
    }

    // Of Stop-VM -AsJob: it runs until it is removed, or has failed with what the model says.
    public sealed class VMJob : Job
    {
        readonly object key;

        public VMJob(object key, Dictionary<string, object> values) : base("Stop-VM", "Stop-VM")
        {
            this.key = key;
            PSJobTypeName = "VMJob";
            object problem;
            if (!values.TryGetValue("Problem", out problem)) { SetJobState(JobState.Running); return; }
            Error.Add(new ErrorRecord(new VirtualizationException((string)problem), "OperationFailed", ErrorCategory.NotSpecified, null));
            SetJobState(JobState.Failed);
        }

        public override bool HasMoreData { get { return Error.Count > 0; } }
        public override string Location { get { return "localhost"; } }
        public override string StatusMessage { get { return ""; } }
        public override void StopJob() { SetJobState(JobState.Stopped); }

        protected override void Dispose(bool disposing)
        {
            base.Dispose(disposing);
            if (disposing) { Wire.Ask("removed", key); }
        }
    }
}
