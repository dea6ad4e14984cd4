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
fields.faulty = ProtoField.bool("tactophone.faulty", "Invalid sound or model output", 8, nil, 0x01)
fields.unknown = ProtoField.bool("tactophone.unknown", "Evidence says neither smooth nor rough", 8, nil, 0x02)
fields.none = ProtoField.double("tactophone.none", "Probability of none")
fields.smooth = ProtoField.double("tactophone.smooth", "Probability of smooth")
fields.rough = ProtoField.double("tactophone.rough", "Probability of rough")
fields.roughness = ProtoField.double("tactophone.roughness", "Roughness")
fields.level = ProtoField.double("tactophone.level_dbfs", "Level (dBFS)")
fields.window = ProtoField.double("tactophone.window", "Length of the window (s)")

local wrong_size = ProtoExpert.new("tactophone.size", "not 16 bytes, or 17 for each finger", expert.group.MALFORMED, expert.severity.ERROR)
prediction.experts = { wrong_size }

local SIZE, ONE, SILENT, RATE = 16, 65535, -32768, 48000

local function share(tree, field, range)
    tree:add(field, range, range:uint() / ONE)
end

local function record(branch, buffer)
    branch:add(fields.touch, buffer(0, 1))
    branch:add(fields.faulty, buffer(1, 1))
    branch:add(fields.unknown, buffer(1, 1))
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

DissectorTable.get("rtp.pt"):add(100, prediction)
DissectorTable.get("rtp.pt"):add(121, prediction)
