// What nova2.cpp uses of SenseGlove's SDK, by its published headers (2026); prints each call.
#pragma once

#include <SenseGlove/Core/CustomWaveform.hpp>

#include <cstdint>
#include <iostream>

namespace SGCore {
enum class EHapticLocation : uint8_t { Unknown, ThumbTip, IndexTip };

struct HandLayer {
    static bool SendCustomWaveform(bool right, CustomWaveform& wave, EHapticLocation place) {
        std::cout << right << ' ' << int(place) << ' ' << wave.amplitude << ' ' << wave.duration << ' '
                  << wave.frequency << std::endl;
        return true;
    }
    static void StopAllHaptics(bool right) { std::cout << "stop " << right << std::endl; }
};
}  // namespace SGCore
