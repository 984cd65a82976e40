// The files of a Windows in folders of Linux: a folder is a drive, and the model shares open files as Windows does.
// `Effects.cs` beside this folder calls these classes instead of those of .NET. Cmdlets reach the same folders by drives
// of PowerShell.
using System;
using System.Collections.Generic;
using System.IO;
using System.Linq;
using System.Management.Automation;
using System.Text;

namespace RarmsTests
{
    /// <summary>System.IO.Path for both kinds of paths: a drive or a backslash makes it one of Windows.</summary>
    public static class WindowsPath
    {
        /// <summary>The folder with drive_c and its like.</summary>
        internal static readonly string Drives = Environment.GetEnvironmentVariable("RARMS_TEST_DRIVES") ?? "/nowhere";

        public static readonly char DirectorySeparatorChar = '\\';

        /// <summary>Return where it lies on this machine.</summary>
        public static string Here(string path)
        {
            if (string.IsNullOrEmpty(path)) { return path; }
            string plain = path.Replace('\\', '/');
            return HasDrive(path) ? Drives + "/drive_" + char.ToLowerInvariant(path[0]) + "/" + plain.Substring(2).TrimStart('/') : plain;
        }

        /// <summary>Return how Windows names what lies in a drive's folder; other paths as they are.</summary>
        public static string There(string path)
        {
            if (HasDrive(path)) { return path.Replace('/', '\\'); }
            string plain = path.Replace('\\', '/');
            string mark = Drives + "/drive_";
            if (!plain.StartsWith(mark, StringComparison.Ordinal)) { return path; }
            string rest = plain.Substring(mark.Length + 1).Replace('/', '\\');
            return char.ToUpperInvariant(plain[mark.Length]) + ":" + (rest == "" ? "\\" : rest);
        }

        /// <summary>Return what scripts get for FullName of a file or folder.</summary>
        public static object FullName(PSObject item) { return There(((FileSystemInfo)item.BaseObject).FullName); }

        public static string Combine(params string[] parts)
        {
            if (!parts.Any(IsOfWindows)) { return Path.Combine(parts); }
            string whole = parts[0];
            foreach (string part in parts.Skip(1)) { whole = IsPathRooted(part) ? part : whole.TrimEnd('\\', '/') + "\\" + part; }
            return whole;
        }

        public static string GetDirectoryName(string path)
        {
            if (!IsOfWindows(path)) { return Path.GetDirectoryName(path); }
            int end = path.TrimEnd('\\', '/').LastIndexOfAny(new[] { '\\', '/' });
            if (end < 0) { return ""; }
            return end > 2 || !HasDrive(path) ? path.Substring(0, end) : path.Length > 3 ? path.Substring(0, 3) : null;
        }

        public static string GetFileName(string path) { return path.Substring(path.LastIndexOfAny(new[] { '\\', '/' }) + 1); }

        public static string GetFileNameWithoutExtension(string path) { return Path.GetFileNameWithoutExtension(GetFileName(path)); }

        public static string GetExtension(string path) { return Path.GetExtension(GetFileName(path)); }

        public static bool IsPathRooted(string path) { return HasDrive(path) || path.StartsWith("/") || path.StartsWith("\\"); }

        public static string GetFullPath(string path) { return HasDrive(path) ? path.Replace('/', '\\') : Path.GetFullPath(path); }

        /// <summary>Return C:\Temp as Linux names it, since pwsh takes no other path for -File.</summary>
        public static string GetTempPath() { return Drives + "/drive_c/Temp/"; }

        private static bool HasDrive(string path) { return path.Length > 1 && path[1] == ':'; }

        private static bool IsOfWindows(string path) { return path.Contains("\\") || HasDrive(path); }
    }

    /// <summary>A file that is open, as the model knows it: it refuses what Windows would.</summary>
    internal sealed class WindowsHandle : IDisposable
    {
        private object _number;

        internal WindowsHandle(string path, FileAccess access, FileShare share)
        {
            string[] rights = { access.ToString(), share.ToString() };
            Dictionary<string, object> answer = Wire.Ask("open", WindowsPath.There(path), "rights", rights);
            string problem = WindowsSession.Refusal(answer);
            if (problem != null) { throw new IOException(problem); }
            _number = answer["handle"];
        }

        public void Dispose()
        {
            if (_number != null) { Wire.Ask("close", _number); }
            _number = null;
        }
    }

    /// <summary>System.IO.FileStream.</summary>
    public class WindowsFileStream : FileStream
    {
        private readonly WindowsHandle _handle;

        public WindowsFileStream(string path, FileMode mode, FileAccess access, FileShare share, int bufferSize)
            : this(path, mode, access, new WindowsHandle(path, access, share), bufferSize) { }

        private WindowsFileStream(string path, FileMode mode, FileAccess access, WindowsHandle handle, int bufferSize)
            : base(Found(path, mode, handle), mode, access, FileShare.ReadWrite | FileShare.Delete, bufferSize) { _handle = handle; }

        private static string Found(string path, FileMode mode, WindowsHandle handle)
        {
            string here = WindowsPath.Here(path);
            bool is_there = System.IO.File.Exists(here);
            if (mode == FileMode.Open && !is_there || mode == FileMode.CreateNew && is_there) { handle.Dispose(); }
            if (mode == FileMode.Open && !is_there) { throw WindowsFile.Missing(path); }
            if (mode == FileMode.CreateNew && is_there) { throw new IOException("The file '" + path + "' already exists."); }
            return here;
        }

        protected override void Dispose(bool disposing)
        {
            base.Dispose(disposing);
            if (disposing && _handle != null) { _handle.Dispose(); }
        }
    }

    /// <summary>System.IO.File.</summary>
    public static class WindowsFile
    {
        internal static FileNotFoundException Missing(string path) { return new FileNotFoundException("Could not find file '" + WindowsPath.There(path) + "'."); }

        public static bool Exists(string path) { return System.IO.File.Exists(WindowsPath.Here(path)); }

        public static FileAttributes GetAttributes(string path)
        {
            string here = WindowsPath.Here(path);
            if (!System.IO.File.Exists(here) && !Directory.Exists(here)) { throw Missing(path); }
            return System.IO.File.GetAttributes(here);
        }

        public static byte[] ReadAllBytes(string path)
        {
            if (!Exists(path)) { throw Missing(path); }
            using (new WindowsHandle(path, FileAccess.Read, FileShare.Read)) { return System.IO.File.ReadAllBytes(WindowsPath.Here(path)); }
        }

        public static string ReadAllText(string path)
        {
            using (MemoryStream bytes = new MemoryStream(ReadAllBytes(path))) { return new StreamReader(bytes, Encoding.UTF8).ReadToEnd(); }
        }

        public static void WriteAllBytes(string path, byte[] bytes)
        {
            using (new WindowsHandle(path, FileAccess.Write, FileShare.Read)) { System.IO.File.WriteAllBytes(WindowsPath.Here(path), bytes); }
        }

        public static void WriteAllText(string path, string contents) { WriteAllBytes(path, new UTF8Encoding(false).GetBytes(contents)); }

        public static void Delete(string path)
        {
            if (!Exists(path)) { return; }
            using (new WindowsHandle(path, 0, FileShare.None)) { System.IO.File.Delete(WindowsPath.Here(path)); }
        }

        public static void Move(string source, string target)
        {
            if (!Exists(source)) { throw Missing(source); }
            using (new WindowsHandle(source, 0, FileShare.None)) { System.IO.File.Move(WindowsPath.Here(source), WindowsPath.Here(target)); }
        }

        public static void Replace(string source, string target, string backup)
        {
            foreach (string path in new[] { source, target }) { if (!Exists(path)) { throw Missing(path); } }
            using (new WindowsHandle(source, 0, FileShare.None))
            using (new WindowsHandle(target, 0, FileShare.None))
            {
                System.IO.File.Replace(WindowsPath.Here(source), WindowsPath.Here(target), string.IsNullOrEmpty(backup) ? null : WindowsPath.Here(backup));
            }
        }
    }

    /// <summary>System.IO.Directory.</summary>
    public static class WindowsDirectory
    {
        public static bool Exists(string path) { return Directory.Exists(WindowsPath.Here(path)); }

        public static DirectoryInfo CreateDirectory(string path) { return Directory.CreateDirectory(WindowsPath.Here(path)); }

        public static string[] GetDirectories(string path, string pattern)
        {
            return Array.ConvertAll(Directory.GetDirectories(WindowsPath.Here(path), pattern), WindowsPath.There);
        }

        public static string[] GetFileSystemEntries(string path, string pattern, SearchOption option)
        {
            return Array.ConvertAll(Directory.GetFileSystemEntries(WindowsPath.Here(path), pattern, option), WindowsPath.There);
        }

        public static void Delete(string path)
        {
            if (Exists(path) && Directory.EnumerateFileSystemEntries(WindowsPath.Here(path)).Any()) { throw new IOException("The directory is not empty. : '" + path + "'"); }
            Directory.Delete(WindowsPath.Here(path));
        }
    }
}
