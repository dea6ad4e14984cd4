-- Wireshark dissector for the predictions of Tactophone's link (docs/reference/wire-format.md).
-- Sound is Opus or L16 in RTP, which Wireshark reads by itself. The link is encrypted: this reads packets before
-- encryption, from `tactophone` logs or a test set-up. Copy it to ~/.local/lib/wireshark/plugins, or:
--   wireshark -X lua_script:tactophone.lua -d udp.port==48470,rtp FILE

local prediction = Proto("tactophone", "Tactophone prediction")

local touches = { [0] = "none", [1] = "smooth", [2] = "rough" }
local fields = prediction.fields
fields.finger = ProtoField.uint8("tactophone.finger", "Finger, from 0", base.DEC, nil, 0x0f)
fields.fingers = ProtoField.uint8("tactophone.fingers", "Fingers of the hand", base.DEC, nil, 0xf0)
fields.touch = ProtoField.uint8("tactophone.touch", "Touch", base.DEC, touches)
fields.faulty = ProtoField.bool("tactophone.faulty", "Invalid sound or model output")
fields.none = ProtoField.double("tactophone.none", "Probability of none")
fields.smooth = ProtoField.double("tactophone.smooth", "Probability of smooth")
fields.rough = ProtoField.double("tactophone.rough", "Probability of rough")
fields.roughness = ProtoField.double("tactophone.roughness", "Roughness")
fields.level = ProtoField.double("tactophone.level_dbfs", "Level (dBFS)")
fields.window = ProtoField.double("tactophone.window", "Length of the window (s)")
fields.unit = ProtoField.uint8("tactophone.haptics.unit", "Unit type", base.DEC, { [2] = "temporal", [4] = "silent" }, 0x70)
fields.duration = ProtoField.double("tactophone.haptics.duration", "Duration of the unit (s)")
fields.effect = ProtoField.uint32("tactophone.haptics.effect", "Number of the effect")
fields.amplitude = ProtoField.double("tactophone.haptics.amplitude", "Amplitude of full drive")
fields.frequency = ProtoField.double("tactophone.haptics.frequency", "Frequency (Hz)")

local wrong_size = ProtoExpert.new("tactophone.size", "not 16 bytes, or 17 for each finger", expert.group.MALFORMED, expert.severity.ERROR)
prediction.experts = { wrong_size }

local SIZE, ONE, SILENT, RATE = 16, 65535, -32768, 48000

local function share(tree, field, range)
    tree:add(field, range, range:uint() / ONE)
end

local function record(branch, buffer)
    branch:add(fields.touch, buffer(0, 1))
    branch:add(fields.faulty, buffer(1, 1))
    share(branch, fields.none, buffer(2, 2))
    share(branch, fields.smooth, buffer(4, 2))
    share(branch, fields.rough, buffer(6, 2))
    share(branch, fields.roughness, buffer(8, 2))
    local level = buffer(10, 2):int()
    branch:add(fields.level, buffer(10, 2), level == SILENT and -math.huge or level / 100)
    branch:add(fields.window, buffer(12, 4), buffer(12, 4):uint() / RATE)
    branch:append_text(", " .. (touches[buffer(0, 1):uint()] or "unknown"))
end

function prediction.dissector(buffer, pinfo, tree)
    local branch, each = tree:add(prediction, buffer()), pinfo.match == 100 and SIZE or SIZE + 1
    if buffer:len() == 0 or buffer:len() % each ~= 0 or (each == SIZE and buffer:len() ~= SIZE) then
        branch:add_proto_expert_info(wrong_size)
        return
    end
    pinfo.cols.protocol = "TACTOPHONE"
    for start = 0, buffer:len() - each, each do
        if each > SIZE then
            branch:add(fields.fingers, buffer(start, 1))
            branch:add(fields.finger, buffer(start, 1))
        end
        record(branch, buffer(start + each - SIZE, SIZE))
    end
end

-- A vibration by RFC 9993: bits of the payload, most significant first, as the tables of the wire format count them.
local haptics = Proto("tactophone_haptics", "Tactophone vibration (RFC 9993)")
local wrong_unit = ProtoExpert.new("tactophone.haptics.kind", "not a silent unit of 10 bytes or a temporal one of 35", expert.group.MALFORMED, expert.severity.ERROR)
haptics.experts = { wrong_unit }

function haptics.dissector(buffer, pinfo, tree)
    local branch, size = tree:add(haptics, buffer()), buffer:len()
    local kind = size > 0 and buffer(0, 1):bitfield(1, 3) or 0
    if not (kind == 4 and size == 10 or kind == 2 and size == 35) then
        branch:add_proto_expert_info(wrong_unit)
        return
    end
    pinfo.cols.protocol = "TACTOPHONE"
    branch:add(fields.unit, buffer(0, 1))
    branch:add(fields.duration, buffer(2, 4), buffer(2, 4):bitfield(4, 24) / RATE)
    if kind == 2 then
        branch:add(fields.effect, buffer(19, 3), buffer(19, 3):bitfield(1, 16))
        branch:add(fields.amplitude, buffer(29, 2), 2 * buffer(29, 2):bitfield(3, 8) / 255 - 1)
        branch:add(fields.frequency, buffer(32, 3), buffer(32, 3):bitfield(3, 16))
    end
end

DissectorTable.get("rtp.pt"):add(102, haptics)
DissectorTable.get("rtp.pt"):add(100, prediction)
DissectorTable.get("rtp.pt"):add(121, prediction)
