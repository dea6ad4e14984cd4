// A participant of eProsima's Fast DDS, the default middleware of ROS 2; it knows of us only the IDL and the topics.
// reader DOMAIN SECONDS: count predictions, read the latched format, send one stop, and say what came.
#include <chrono>
#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/publisher/DataWriter.hpp>
#include <fastdds/dds/publisher/Publisher.hpp>
#include <fastdds/dds/subscriber/DataReader.hpp>
#include <fastdds/dds/subscriber/SampleInfo.hpp>
#include <fastdds/dds/subscriber/Subscriber.hpp>
#include <iostream>
#include <string>
#include <thread>

#include "tactophonePubSubTypes.h"

using namespace eprosima::fastdds::dds;

int main(int, char** arguments) {
  auto* participant = DomainParticipantFactory::get_instance()->create_participant(
      std::stoi(arguments[1]), PARTICIPANT_QOS_DEFAULT);
  auto* subscriber = participant->create_subscriber(SUBSCRIBER_QOS_DEFAULT);
  auto topic = [&](TypeSupport type, const char* name) {
    type.register_type(participant);
    return participant->create_topic(name, type.get_type_name(), TOPIC_QOS_DEFAULT);
  };
  auto reader = [&](Topic* from, bool latched) {
    DataReaderQos qos = DATAREADER_QOS_DEFAULT;
    qos.reliability().kind = RELIABLE_RELIABILITY_QOS;
    qos.durability().kind = latched ? TRANSIENT_LOCAL_DURABILITY_QOS : VOLATILE_DURABILITY_QOS;
    qos.history().depth = 200;
    return subscriber->create_datareader(from, qos);
  };
  namespace ours = tactophone_msgs::msg::dds_;
  namespace audio = audio_common_msgs::msg::dds_;
  namespace standard = std_msgs::msg::dds_;
  auto* touches = reader(topic(TypeSupport(new ours::Prediction_PubSubType()), "rt/tactophone/index/touch"), false);
  auto* infos = reader(topic(TypeSupport(new audio::AudioInfo_PubSubType()), "rt/tactophone/index/audio_info"), true);
  auto* stop = participant->create_publisher(PUBLISHER_QOS_DEFAULT)
                   ->create_datawriter(topic(TypeSupport(new standard::Empty_PubSubType()), "rt/tactophone/stop"),
                                       DATAWRITER_QOS_DEFAULT);
  int predictions = 0;
  unsigned rate = 0;
  float rough = -1;
  bool stopped = false;
  SampleInfo info;
  const auto until = std::chrono::steady_clock::now() + std::chrono::seconds(std::stoi(arguments[2]));
  while (std::chrono::steady_clock::now() < until && !stopped) {
    ours::Prediction_ touch;
    while (touches->take_next_sample(&touch, &info) == ReturnCode_t::RETCODE_OK)
      if (info.valid_data) predictions++, rough = touch.probabilities()[2];
    audio::AudioInfo_ format;
    while (infos->take_next_sample(&format, &info) == ReturnCode_t::RETCODE_OK)
      if (info.valid_data) rate = format.sample_rate();
    if (predictions >= 20 && rate) {
      standard::Empty_ empty;
      stopped = stop->write(&empty);
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  std::cout << "predictions " << predictions << " rate " << rate << " rough " << rough << std::endl;
  std::this_thread::sleep_for(std::chrono::milliseconds(500));
  return stopped ? 0 : 1;
}
