// Vibrates a SenseGlove Nova 2: lines "finger amplitude hertz" from standard input become custom waveforms.
//
//   g++ -std=c++17 nova2.cpp -I SDK/include -L SDK/lib ... -o nova2
//   python -m devices_tactophone.senseglove RUN | ./nova2 right
//
// SDK is github.com/Adjuvo/SenseGlove-API. A waveform lasts DURATION, so that a run that ends is silent by then.
#include <SenseGlove/Core/CustomWaveform.hpp>
#include <SenseGlove/Core/HandLayer.hpp>

#include <algorithm>
#include <iostream>
#include <string>

using SGCore::EHapticLocation;
using SGCore::HandLayer;

constexpr float DURATION = 0.1f;              // s
constexpr float LOWEST = 10, HIGHEST = 500;  // Hz of the glove

int main(int count, char** words) {
    const bool right = count < 2 || std::string(words[1]) != "left";
    std::string finger;
    float amplitude, hertz;
    while (std::cin >> finger >> amplitude >> hertz) {
        const auto place = finger == "thumb"   ? EHapticLocation::ThumbTip
                           : finger == "index" ? EHapticLocation::IndexTip
                                               : EHapticLocation::Unknown;  // it has no other tips
        if (place == EHapticLocation::Unknown || !(amplitude > 0) || !(hertz > 0)) continue;
        SGCore::CustomWaveform wave(std::min(amplitude, 1.0f), DURATION, std::clamp(hertz, LOWEST, HIGHEST));
        HandLayer::SendCustomWaveform(right, wave, place);
    }
    HandLayer::StopAllHaptics(right);
}
