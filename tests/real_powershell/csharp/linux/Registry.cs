// The registry of PowerShell for Windows, which PowerShell for Linux lacks: HKLM: and HKCU:, whose keys the model has.
using System;
using System.Collections.Generic;
using System.Collections.ObjectModel;
using System.Globalization;
using System.IO;
using System.Linq;
using System.Management.Automation;
using System.Management.Automation.Provider;
using Microsoft.Win32;

namespace RarmsTests
{
    /// <summary>What Get-Item gives of a key: the part of Microsoft.Win32.RegistryKey that scripts use.</summary>
    public sealed class WindowsKey
    {
        private readonly object[][] _values; // name, kind, data
        private readonly string[] _below;

        internal WindowsKey(string path, Dictionary<string, object> read)
        {
            Name = path.Replace('/', '\\');
            _below = Array.ConvertAll((object[])read["below"], one => (string)one);
            _values = ((object[])read["values"]).Cast<object[]>().ToArray();
        }

        public string Name { get; private set; }

        public int ValueCount { get { return _values.Length; } }

        public int SubKeyCount { get { return _below.Length; } }

        public string[] GetSubKeyNames() { return _below; }

        public string[] GetValueNames() { return Array.ConvertAll(_values, one => (string)one[0]); }

        public object GetValue(string name) { return GetValue(name, null); }

        public object GetValue(string name, object otherwise)
        {
            object[] found = Find(name);
            return found == null ? otherwise : AsRead(found);
        }

        public RegistryValueKind GetValueKind(string name)
        {
            object[] found = Find(name);
            if (found == null) { throw new IOException("The specified registry key does not exist."); }
            return (RegistryValueKind)Enum.Parse(typeof(RegistryValueKind), (string)found[1]);
        }

        private object[] Find(string name)
        {
            return Array.Find(_values, one => string.Equals((string)one[0], name ?? "", StringComparison.OrdinalIgnoreCase));
        }

        private static object AsRead(object[] value)
        {
            string data = (string)value[2];
            switch ((string)value[1])
            {
                case "DWord": return unchecked((int)uint.Parse(data, CultureInfo.InvariantCulture));
                case "QWord": return unchecked((long)ulong.Parse(data, CultureInfo.InvariantCulture));
                case "Binary":
                    return data.Split(new[] { ' ' }, StringSplitOptions.RemoveEmptyEntries).Select(byte.Parse).ToArray();
                case "ExpandString": return Environment.ExpandEnvironmentVariables(data);
                case "MultiString": return data.Split('\n');
                default: return data;
            }
        }
    }

    /// <summary>The provider, with the errors of Windows'.</summary>
    [CmdletProvider("Registry", ProviderCapabilities.ShouldProcess)]
    public sealed class WindowsRegistry : NavigationCmdletProvider, IDynamicPropertyCmdletProvider
    {
        private static readonly string[,] Roots = { { "HKLM", "HKEY_LOCAL_MACHINE" }, { "HKCU", "HKEY_CURRENT_USER" } };

        public override char ItemSeparator { get { return '\\'; } }

        public override char AltItemSeparator { get { return '/'; } }

        protected override Collection<PSDriveInfo> InitializeDefaultDrives()
        {
            Collection<PSDriveInfo> drives = new Collection<PSDriveInfo>();
            for (int at = 0; at < Roots.GetLength(0); at++)
            {
                drives.Add(new PSDriveInfo(Roots[at, 0], ProviderInfo, Roots[at, 1], "", null));
            }
            WindowsSession.Open(SessionState);  // nothing else is told when a session opens
            return drives;
        }

        protected override bool IsValidPath(string path) { return true; }

        protected override bool ItemExists(string path) { return Read(path) != null; }

        protected override bool IsItemContainer(string path) { return Read(path) != null; }

        protected override bool HasChildItems(string path)
        {
            WindowsKey found = Read(path);
            return found != null && found.SubKeyCount > 0;
        }

        protected override void GetItem(string path)
        {
            WindowsKey found = Read(path);
            if (found != null) { WriteItemObject(found, path, true); }
        }

        protected override void GetChildItems(string path, bool recurse)
        {
            foreach (string child in Below(path))
            {
                WriteItemObject(Read(child), child, true);
                if (recurse) { GetChildItems(child, true); }
            }
        }

        protected override void GetChildNames(string path, ReturnContainers returnContainers)
        {
            foreach (string child in Below(path)) { WriteItemObject(GetChildName(child), child, true); }
        }

        protected override void NewItem(string path, string itemTypeName, object newItemValue)
        {
            if (Read(GetParentPath(path, null)) == null)
            {
                Exception lack = new ArgumentException("The registry key at the specified path does not exist.");
                WriteError(new ErrorRecord(lack, lack.GetType().FullName, ErrorCategory.InvalidArgument, path));
            }
            else if (Read(path) != null && !Force)
            {
                Exception there = new IOException("A key in this path already exists.");
                WriteError(new ErrorRecord(there, there.GetType().FullName, ErrorCategory.ResourceExists, path));
            }
            else if (ShouldProcess(path, "New Key"))
            {
                Change("New-Item", path);
                WriteItemObject(Read(path), path, true);
            }
        }

        protected override void RemoveItem(string path, bool recurse)
        {
            if (recurse) { foreach (string child in Below(path)) { RemoveItem(child, true); } }
            if (ShouldProcess(path, "Remove Key")) { Change("Remove-Item", path); }
        }

        public void NewProperty(string path, string propertyName, string propertyTypeName, object value)
        {
            WindowsKey key = ReadOrError(path);
            if (key == null || !ShouldProcess("Item: " + path + " Property: " + propertyName, "New Property")) { return; }
            RegistryValueKind kind;
            if (!Enum.TryParse(propertyTypeName ?? "String", true, out kind)) { kind = RegistryValueKind.Unknown; }
            if (kind == RegistryValueKind.Unknown || kind == RegistryValueKind.None)
            {
                Exception bad = new ArgumentException("The type " + propertyTypeName + " is not a known type for the registry.");
                WriteError(new ErrorRecord(bad, bad.GetType().FullName, ErrorCategory.InvalidArgument, path));
                return;
            }
            if (!Force && key.GetValueNames().Contains(propertyName, StringComparer.OrdinalIgnoreCase))
            {
                Exception there = new IOException("The property already exists.");
                WriteError(new ErrorRecord(there, there.GetType().FullName, ErrorCategory.ResourceExists, path));
                return;
            }
            Change("New-ItemProperty", path, "name", propertyName, "kind", kind.ToString(), "data", AsWritten(kind, value));
            PSObject made = new PSObject();
            made.Properties.Add(new PSNoteProperty(propertyName, Read(path).GetValue(propertyName)));
            WritePropertyObject(made, path);
        }

        public void RemoveProperty(string path, string propertyName)
        {
            WindowsKey key = ReadOrError(path);
            if (key == null) { return; }
            if (!key.GetValueNames().Contains(propertyName, StringComparer.OrdinalIgnoreCase))
            {
                Exception lack = new PSArgumentException("Property " + propertyName + " does not exist at path " + path + ".");
                WriteError(new ErrorRecord(lack, lack.GetType().FullName, ErrorCategory.InvalidArgument, propertyName));
            }
            else if (ShouldProcess("Item: " + path + " Property: " + propertyName, "Remove Property"))
            {
                Change("Remove-ItemProperty", path, "name", propertyName);
            }
        }

        public void GetProperty(string path, Collection<string> names)
        {
            WindowsKey key = ReadOrError(path);
            if (key == null) { return; }
            PSObject found = new PSObject();
            foreach (string name in key.GetValueNames())
            {
                if (names == null || names.Count == 0 || names.Contains(name, StringComparer.OrdinalIgnoreCase))
                {
                    found.Properties.Add(new PSNoteProperty(name, key.GetValue(name)));
                }
            }
            foreach (string name in names ?? new Collection<string>())
            {
                if (found.Properties[name] != null) { continue; }
                Exception lack = new PSArgumentException("Property " + name + " does not exist at path " + path + ".");
                WriteError(new ErrorRecord(lack, lack.GetType().FullName, ErrorCategory.InvalidArgument, name));
            }
            WritePropertyObject(found, path);
        }

        public void SetProperty(string path, PSObject propertyValue) { throw new PSNotSupportedException(); }

        public void ClearProperty(string path, Collection<string> propertyToClear) { throw new PSNotSupportedException(); }

        public object GetPropertyDynamicParameters(string path, Collection<string> names) { return null; }

        public object SetPropertyDynamicParameters(string path, PSObject propertyValue) { return null; }

        public object ClearPropertyDynamicParameters(string path, Collection<string> propertyToClear) { return null; }

        public object NewPropertyDynamicParameters(string path, string propertyName, string propertyTypeName, object value) { return null; }

        public object RemovePropertyDynamicParameters(string path, string propertyName) { return null; }

        public void RenameProperty(string path, string sourceProperty, string destinationProperty) { throw new PSNotSupportedException(); }

        public object RenamePropertyDynamicParameters(string path, string sourceProperty, string destinationProperty) { return null; }

        public void CopyProperty(string sourcePath, string sourceProperty, string destinationPath, string destinationProperty) { throw new PSNotSupportedException(); }

        public object CopyPropertyDynamicParameters(string sourcePath, string sourceProperty, string destinationPath, string destinationProperty) { return null; }

        public void MoveProperty(string sourcePath, string sourceProperty, string destinationPath, string destinationProperty) { throw new PSNotSupportedException(); }

        public object MovePropertyDynamicParameters(string sourcePath, string sourceProperty, string destinationPath, string destinationProperty) { return null; }

        /// <summary>Return a value as the model keeps it; numbers are without sign there.</summary>
        private static string AsWritten(RegistryValueKind kind, object value)
        {
            object plain = value is PSObject ? ((PSObject)value).BaseObject : value;
            switch (kind)
            {
                case RegistryValueKind.DWord:
                    try { return unchecked((uint)Convert.ToInt32(plain, CultureInfo.InvariantCulture)).ToString(CultureInfo.InvariantCulture); }
                    catch (OverflowException) { return Convert.ToUInt32(plain, CultureInfo.InvariantCulture).ToString(CultureInfo.InvariantCulture); }
                case RegistryValueKind.QWord:
                    try { return unchecked((ulong)Convert.ToInt64(plain, CultureInfo.InvariantCulture)).ToString(CultureInfo.InvariantCulture); }
                    catch (OverflowException) { return Convert.ToUInt64(plain, CultureInfo.InvariantCulture).ToString(CultureInfo.InvariantCulture); }
                case RegistryValueKind.Binary: return string.Join(" ", (byte[])LanguagePrimitives.ConvertTo(plain, typeof(byte[])));
                case RegistryValueKind.MultiString: return string.Join("\n", (string[])LanguagePrimitives.ConvertTo(plain, typeof(string[])));
                default: return (string)LanguagePrimitives.ConvertTo(plain, typeof(string), CultureInfo.InvariantCulture);
            }
        }

        private void Change(string cmdlet, string path, params string[] more)
        {
            Dictionary<string, object> answer = Wire.Ask(new object[] { "registry", cmdlet, "path", OfModel(path) }.Concat(more).ToArray());
            string problem = WindowsSession.Refusal(answer);
            if (problem == null) { return; }
            Exception refused = new System.Security.SecurityException(problem);
            ThrowTerminatingError(new ErrorRecord(refused, refused.GetType().FullName, ErrorCategory.PermissionDenied, path));
        }

        private WindowsKey ReadOrError(string path)
        {
            WindowsKey found = Read(path);
            if (found == null)
            {
                Exception lack = new ItemNotFoundException("Cannot find path '" + path + "' because it does not exist.");
                WriteError(new ErrorRecord(lack, "PathNotFound", ErrorCategory.ObjectNotFound, path));
            }
            return found;
        }

        private IEnumerable<string> Below(string path)
        {
            WindowsKey found = Read(path);
            string[] names = found == null ? new string[0] : found.GetSubKeyNames();
            return names.Select(name => MakePath(path, name)).ToArray();
        }

        private static WindowsKey Read(string path)
        {
            Dictionary<string, object> read = Wire.Ask("key", OfModel(path));
            return read.ContainsKey("values") ? new WindowsKey(path, read) : null;
        }

        /// <summary>Return HKEY_LOCAL_MACHINE\SOFTWARE as HKLM:\SOFTWARE.</summary>
        private static string OfModel(string path)
        {
            string plain = path.Replace('/', '\\').TrimEnd('\\');
            for (int at = 0; at < Roots.GetLength(0); at++)
            {
                string root = Roots[at, 1];
                if (plain.Equals(root, StringComparison.OrdinalIgnoreCase)) { return Roots[at, 0] + ":"; }
                if (plain.StartsWith(root + "\\", StringComparison.OrdinalIgnoreCase)) { return Roots[at, 0] + ":" + plain.Substring(root.Length); }
            }
            return plain;
        }
    }
}
