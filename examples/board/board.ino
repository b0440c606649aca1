// A board for emsid: samples a motor at 500 Hz and takes voltage commands, in the protocol of docs/line-protocol.md.
//
// Wiring: an H-bridge on PIN_PWM and PIN_DIRECTION, an incremental encoder on PIN_A (an interrupt pin) and PIN_B.
// Track it:  emsid track serial:///dev/ttyACM0 --structure friction-narx
// Drive it:  emsid bench run --source serial:///dev/ttyACM0 --limit 6V --out record.csv

const int PIN_PWM = 9, PIN_DIRECTION = 8, PIN_A = 2, PIN_B = 3;
const float SUPPLY = 12.0;            // V at full PWM
const float COUNTS_PER_TURN = 1024;   // rising edges of channel A
const unsigned long PERIOD = 2000;    // us between two samples
const unsigned long WATCHDOG = 500;   // ms without a command after which the motor is switched off

volatile long counts = 0;
unsigned long number = 0, next_sample = 0, last_command = 0;
long last_counts = 0;
float voltage = 0.0;
char line[32];
byte length = 0;

void count() {
  if (digitalRead(PIN_B)) counts--; else counts++;
}

void apply(float volts) {
  voltage = constrain(volts, -SUPPLY, SUPPLY);
  digitalWrite(PIN_DIRECTION, voltage < 0 ? HIGH : LOW);
  analogWrite(PIN_PWM, (int)(255.0 * fabs(voltage) / SUPPLY + 0.5));
}

void header() {
  Serial.println(F("n,t[us],voltage[V],speed[rad/s]"));
}

void command() {
  last_command = millis();
  if (line[0] == 'u' && line[1] == ' ') apply(atof(line + 2));
  else if (strcmp(line, "stop") == 0) apply(0.0);
  else if (strcmp(line, "?") == 0) header();
}

void setup() {
  pinMode(PIN_PWM, OUTPUT);
  pinMode(PIN_DIRECTION, OUTPUT);
  pinMode(PIN_A, INPUT_PULLUP);
  pinMode(PIN_B, INPUT_PULLUP);
  apply(0.0);
  attachInterrupt(digitalPinToInterrupt(PIN_A), count, RISING);
  Serial.begin(500000);               // emsid ... --baud 500000; boards with native USB ignore the number
  header();
  next_sample = micros();
}

void loop() {
  while (Serial.available()) {
    char c = Serial.read();
    if (c == '\n') {
      line[length] = 0;
      command();
      length = 0;
    } else if (c != '\r' && length < sizeof(line) - 1) {
      line[length++] = c;
    }
  }
  if (voltage != 0.0 && millis() - last_command > WATCHDOG) apply(0.0);

  if ((long)(micros() - next_sample) >= 0) {
    unsigned long now = next_sample;
    next_sample += PERIOD;
    noInterrupts();
    long here = counts;
    interrupts();
    float speed = (here - last_counts) * (6.2831853 / COUNTS_PER_TURN) * (1e6 / PERIOD);
    last_counts = here;
    Serial.print(number++);
    Serial.print(',');
    Serial.print(now);
    Serial.print(',');
    Serial.print(voltage, 3);
    Serial.print(',');
    Serial.println(speed, 3);
  }
}
