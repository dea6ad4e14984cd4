// What nova2.cpp uses of SenseGlove's SDK, by its published headers (2026).
#pragma once

namespace SGCore {
struct CustomWaveform {
    CustomWaveform(float amplitude, float duration, float frequency)
        : amplitude(amplitude), duration(duration), frequency(frequency) {}
    float amplitude, duration, frequency;
};
}  // namespace SGCore
