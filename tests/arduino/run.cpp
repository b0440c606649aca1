// Runs a sketch: the clock at the start in us, then pairs of a time from the start in us and a command, the last one
// empty. What the board sends goes to the standard output.
#include "Arduino.h"
#include SKETCH

int main(int count, char** words) {
  unsigned long start = strtoul(words[1], nullptr, 10);
  board.clock = start;
  setup();
  for (int k = 2; k + 1 < count; k += 2) {
    while (board.clock - start < strtoul(words[k], nullptr, 10)) loop();
    if (words[k + 1][0]) board.incoming += std::string(words[k + 1]) + "\n";
  }
  fputs(board.outgoing.c_str(), stdout);
}
