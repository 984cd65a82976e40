# An interfering load that bursts, inside a Windows guest: threads that wake together, work, and sleep.
# Arguments: how many threads, how long a cycle lasts (us), and which part of it each thread works (per mille; 0: what
# its partition reserves, in per cent in RARMS_RESERVE). A guest cannot see what is taken from it, so a burst is a counted
# amount of work: as much as the fastest of a hundred windows of 10 ms did, which nothing interrupted. It writes a line
# when it has counted that: then the components begin.
param([int] $Threads, [long] $EveryMicroseconds, [int] $Duty)
$ErrorActionPreference = 'Stop'
Add-Type -TypeDefinition @'
using System;
using System.Diagnostics;
using System.Runtime.InteropServices;
using System.Threading;

public static class Bursts
{
    [DllImport("winmm.dll")] static extern uint timeBeginPeriod(uint milliseconds);

    const long Chunk = 2000;
    static long sink;

    static void Work(long count)
    {
        long value = 1;
        for (long at = 0; at < count; at++) value = value * 6364136223846793005L + 1442695040888963407L;
        Interlocked.Add(ref sink, value);
    }

    static double Fastest()
    {
        double fastest = 0;
        for (int window = 0; window < 100; window++)
        {
            long begun = Stopwatch.GetTimestamp(), end = begun + Stopwatch.Frequency / 100, done = 0, now;
            do { Work(Chunk); done += Chunk; now = Stopwatch.GetTimestamp(); } while (now < end);
            fastest = Math.Max(fastest, done * (double) Stopwatch.Frequency / (now - begun));
        }
        return fastest;
    }

    public static void Run(int threads, double everySeconds, double duty)
    {
        timeBeginPeriod(1);
        long count = (long) (Fastest() * everySeconds * duty);
        Console.Out.WriteLine("calibrated");
        Console.Out.Flush();
        double gap = everySeconds * (1 - duty);
        var chance = new Random();
        var together = new Barrier(threads + 1);
        for (int number = 0; number < threads; number++)
        {
            var thread = new Thread(() => { while (true) { together.SignalAndWait(); Work(count); together.SignalAndWait(); } });
            thread.IsBackground = true;
            thread.Start();
        }
        while (true)
        {
            long wake = Stopwatch.GetTimestamp() + (long) (gap * (0.5 + chance.NextDouble()) * Stopwatch.Frequency);
            while (wake - Stopwatch.GetTimestamp() > Stopwatch.Frequency / 500) Thread.Sleep(1);
            together.SignalAndWait();
            together.SignalAndWait();
        }
    }
}
'@
$part = if ($Duty) { $Duty / 1000 } else { [Math]::Max(1, [int] $env:RARMS_RESERVE) / 100 }
[Bursts]::Run($Threads, $EveryMicroseconds / 1000000, $part)
