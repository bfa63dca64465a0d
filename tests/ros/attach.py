"""What a debugger does to a process.

attach.py hold PID TIMES: attaches to every thread and lets go again; prints how many there were.
attach.py break PID THREAD: makes the next wait for events of the thread whose name begins so fail, by putting something else in
the place of what it waits on."""
import ctypes
import os
import platform
import sys
import time

ATTACH, DETACH, GETREGS, SETREGS, SINGLESTEP = 16, 17, 12, 13, 9
WALL = 0x40000000
DUP2, EPOLL_WAIT, EPOLL_PWAIT = 33, 232, 281  # of x86-64
REGISTERS = "r15 r14 r13 r12 rbp rbx r11 r10 r9 r8 rax rcx rdx rsi rdi orig_rax rip cs eflags rsp ss fs_base gs_base ds es fs gs"


class Registers(ctypes.Structure):
    _fields_ = [(name, ctypes.c_ulonglong) for name in REGISTERS.split()]


libc = ctypes.CDLL(None, use_errno=True)
libc.ptrace.argtypes = [ctypes.c_long, ctypes.c_long, ctypes.c_void_p, ctypes.c_void_p]


def ptrace(request, tid, data=None):
    """Whether it was done; a thread may have ended meanwhile."""
    if libc.ptrace(request, tid, None, data) == 0:
        return True
    error = ctypes.get_errno()
    if error == 3:  # ESRCH
        return False
    raise OSError(error, os.strerror(error))


def threads(pid):
    return [int(tid) for tid in os.listdir(f"/proc/{pid}/task")]


def hold(pid, times):
    for _ in range(int(times)):
        held = [tid for tid in threads(pid) if ptrace(ATTACH, tid)]
        for tid in held:
            os.waitpid(tid, WALL)
        time.sleep(0.05)
        for tid in held:
            ptrace(DETACH, tid)
        time.sleep(0.05)
    print(len(held))


def name(pid, tid):
    with open(f"/proc/{pid}/task/{tid}/comm") as comm:
        return comm.read()


def break_(pid, thread):
    assert platform.machine() == "x86_64", "this knows the registers of x86-64 only"
    found = [tid for tid in threads(pid) if name(pid, tid).startswith(thread)]
    assert len(found) == 1, [name(pid, tid) for tid in threads(pid)]
    tid, registers = found[0], Registers()
    for _ in range(1000):
        ptrace(ATTACH, tid)
        os.waitpid(tid, WALL)
        ptrace(GETREGS, tid, ctypes.addressof(registers))
        if registers.orig_rax in (EPOLL_WAIT, EPOLL_PWAIT):
            break
        ptrace(DETACH, tid)
        time.sleep(0.003)
    else:
        sys.exit(f"{thread} never waits for events")
    replacing = Registers.from_buffer_copy(registers)
    none = 2**64 - 1
    replacing.rax, replacing.orig_rax, replacing.rip = DUP2, none, registers.rip - 2
    replacing.rdi, replacing.rsi = 1, registers.rdi  # stdout in the place of the epoll
    ptrace(SETREGS, tid, ctypes.addressof(replacing))
    ptrace(SINGLESTEP, tid)
    os.waitpid(tid, WALL)
    registers.rax, registers.orig_rax = 2**64 - 4, none  # EINTR
    ptrace(SETREGS, tid, ctypes.addressof(registers))
    ptrace(DETACH, tid)
    print("ok")


{"hold": hold, "break": break_}[sys.argv[1]](int(sys.argv[2]), sys.argv[3])
