"""Times of the binding, as ratios within one run where they can be: python tests/python/bench.py

- two solves on two threads, over one alone and over two processes: 1 where the lock is free and two cores are;
- ten million numbers to numpy and to Arrow, over copying them;
- from Ctrl-C to the end of a solve, in milliseconds;
- a small solve in this process, over the same by a service's JSON read back.
"""

import os
import signal
import threading
import time
import warnings

import numpy as np

import dvi

warnings.simplefilter("ignore")


def timed(work):
    began = time.perf_counter()
    done = work()
    return time.perf_counter() - began, done


def chain(n, end):
    states = {
        **{f"x{k}": {"initial": k % 3, "rate": f"v{k}"} for k in range(n)},
        **{f"v{k}": {"initial": 0, "rate": f"-x{k}*x{k}*x{k} - x{(k + 1) % n}"} for k in range(n)},
    }
    return {"problem": {"dvi": {"states": states}}, "time": {"end": end}, "output": {"times": {"count": 2}}, "method": {"rtol": 1e-9}}


def two_threads():
    spec = chain(6, 500.0)
    alone = min(timed(lambda: dvi.solve(spec))[0] for _ in range(3))

    def threads():
        both = [threading.Thread(target=dvi.solve, args=(spec,)) for _ in range(2)]
        [thread.start() for thread in both]
        [thread.join() for thread in both]

    def processes():
        both = [os.fork() for _ in range(1)]
        dvi.solve(spec)
        if 0 in both:
            os._exit(0)
        os.waitpid(both[0], 0)

    together, apart = (min(timed(work)[0] for _ in range(3)) for work in (threads, processes))
    print(f"two threads over one: {together / alone:.2f}, over two processes: {together / apart:.2f} ({alone * 1e3:.0f} ms alone)")


def hand_over():
    spec = {
        "problem": {"dvi": {"states": {f"x{k}": {"initial": k, "rate": "0"} for k in range(10)}}},
        "time": {"end": 1},
        "output": {"times": {"count": 1_000_000}},
    }
    r = dvi.solve(spec)
    views, columns = timed(lambda: [r[name] for name in r.names])
    copies, _ = timed(lambda: [column.copy() for column in columns])
    print(f"1e7 numbers to numpy: {views * 1e3:.3f} ms, copying them {copies * 1e3:.1f} ms")
    try:
        arrow, _ = timed(r.to_arrow)
        print(f"1e7 numbers to Arrow: {arrow * 1e3:.3f} ms (the first, with the import)")
    except ImportError:
        pass


def interrupt():
    spec = {**chain(2, 1e9)}
    latencies = []
    for _ in range(10):
        sent = []

        def send():
            sent.append(time.perf_counter())
            os.kill(os.getpid(), signal.SIGINT)

        threading.Timer(0.2, send).start()
        try:
            dvi.solve(spec)
        except KeyboardInterrupt:
            latencies.append(time.perf_counter() - sent[0])
    print(f"Ctrl-C to the end: median {np.median(latencies) * 1e3:.1f} ms, worst {max(latencies) * 1e3:.1f} ms")


def small():
    spec = dvi.example("friction_belt")
    alone = min(timed(lambda: dvi.solve(spec))[0] for _ in range(50))
    json = dvi.solve(spec).to_json()
    read = min(timed(lambda: dvi.Result.from_json(json).status)[0] for _ in range(50))
    print(f"a small solve: {alone * 1e3:.2f} ms; its JSON read back alone: {read * 1e3:.2f} ms")


if __name__ == "__main__":
    two_threads()
    hand_over()
    interrupt()
    small()
