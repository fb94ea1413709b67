// The rig's side of `morpholab play --format csv`, for an Arduino: reads lines, sets pressures, vents when told, when a
// sample is missing, or when nobody speaks.

const int CHANNELS = 11;                 // core, bladders 1 to 8, feet 1 and 2
const unsigned long SILENCE = 2000;      // after which lines are vented [ms]; heartbeats come every 500 ms
const int LONGEST = 240;                 // characters of a line

char line[LONGEST + 1];
int length = 0;
bool tooLong = false;
long expected = -1;                      // number of the next sample; -1 before a header
unsigned long heard = 0;

void setPressure(int channel, float pressure) {
  // Replace this by what sets your regulator, for example analogWrite of a voltage. Units are those of the header.
  (void)channel;
  (void)pressure;
}

void vent() {
  for (int channel = 0; channel < CHANNELS; channel++) setPressure(channel, 0.0);
  expected = -1;                         // nothing is played before a new header
}

void takeSample(char *rest) {            // after "S,": number,time,section,pressures
  char *end;
  long number = strtol(rest, &end, 10);
  if (number != expected) { vent(); Serial.println("stop"); return; }
  for (int skipped = 0; skipped < 3; skipped++) {
    end = strchr(end, ',');
    if (!end) return;                    // a line that was cut
    end++;
  }
  float pressures[CHANNELS];
  for (int channel = 0; channel < CHANNELS; channel++) {
    char *begin = end;
    pressures[channel] = strtod(begin, &end);
    char follows = channel + 1 < CHANNELS ? ',' : '\0';
    if (end == begin || *end != follows) return;
    end++;
  }
  for (int channel = 0; channel < CHANNELS; channel++) setPressure(channel, pressures[channel]);
  expected++;
  Serial.print("ok ");
  Serial.println(number);
}

void takeLine() {
  if (line[0] == 'H' && line[1] == ',') expected = 0;
  else if (line[0] == 'S' && line[1] == ',' && expected >= 0) takeSample(line + 2);
  else if (strncmp(line, "STOP", 4) == 0) vent();
}

void setup() {
  Serial.begin(115200);
  vent();
}

void loop() {
  while (Serial.available() > 0) {
    char c = Serial.read();
    heard = millis();
    if (c == '\n') {
      line[length] = '\0';
      if (!tooLong) takeLine();
      length = 0;
      tooLong = false;
    } else if (length < LONGEST) {
      line[length++] = c;
    } else {
      tooLong = true;
    }
  }
  if (expected >= 0 && millis() - heard > SILENCE) vent();
}
