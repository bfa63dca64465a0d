"""Counts the packets on loopback that hold each of these words in the clear, until stdin ends; prints the counts."""
import select
import socket
import sys

words = [word.encode() for word in sys.argv[1:]]
counts = [0] * len(words)
every_protocol = 0x0003
wire = socket.socket(socket.AF_PACKET, socket.SOCK_RAW, socket.htons(every_protocol))
wire.bind(("lo", 0))
print("ready", flush=True)
while True:
    readable, _, _ = select.select([wire, sys.stdin], [], [])
    if wire in readable:
        packet = wire.recv(65536)
        counts = [count + (word in packet) for count, word in zip(counts, words)]
    elif sys.stdin in readable and not sys.stdin.readline():
        break
print(*counts)
