// What examples/board/board.ino uses of an Arduino-class board, on a computer: a clock of 32 bits that advances with
// every look at it, a serial port, and a motor whose speed follows its voltage.
#pragma once
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <string>
#define long int  // 32 bits, as on such a board

typedef unsigned char byte;
enum { LOW, HIGH, OUTPUT, INPUT_PULLUP, RISING };
#define F(text) text
#define constrain(x, low, high) ((x) < (low) ? (low) : (x) > (high) ? (high) : (x))

struct Board {
  unsigned long clock = 0;  // us
  std::string incoming;
  std::string outgoing;
  int duty = 0, backwards = 0;
  double angle = 0;  // rising edges of the encoder
  void (*edge)() = nullptr;

  void pass(unsigned long us) {
    clock += us;
    angle += duty * 1e-6 * us * 100;  // 100 edges a second for each of 255 steps of the PWM
    for (; angle >= 1; angle -= 1) edge();
  }
};
inline Board board;

inline unsigned long micros() { board.pass(20); return board.clock; }
inline unsigned long millis() { return board.clock / 1000; }
inline void pinMode(int, int) {}
inline int digitalRead(int) { return board.backwards; }
inline void digitalWrite(int, int value) { board.backwards = value; }
inline void analogWrite(int, int value) { board.duty = value; }
inline int digitalPinToInterrupt(int pin) { return pin; }
inline void attachInterrupt(int, void (*edge)(), int) { board.edge = edge; }
inline void noInterrupts() {}
inline void interrupts() {}

struct Port {
  void begin(unsigned long) {}
  int available() { return (int)board.incoming.size(); }
  int read() { char c = board.incoming[0]; board.incoming.erase(0, 1); return c; }
  void print(unsigned long value) { board.outgoing += std::to_string(value); }
  void print(char value) { board.outgoing += value; }
  void print(double value, int digits) { char text[40]; snprintf(text, sizeof text, "%.*f", digits, value); board.outgoing += text; }
  void println(const char* text) { board.outgoing += std::string(text) + "\r\n"; }
  void println(double value, int digits) { print(value, digits); board.outgoing += "\r\n"; }
};
inline Port Serial;
