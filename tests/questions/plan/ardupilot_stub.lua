-- The part of ArduPilot's scripting interface that an injected sequence uses; the test sets what the aircraft does.
stub = {
  now = 1000, switch = 0, armed = true, mode = 0, radio = true, eas = 13.0, eas2tas = 1.0, roll = 0.0, pitch = 0.05,
  down = -100.0, az = -9.80665, sent = {}, logged = {}, texts = {}, channel_outputs = true,
  params = { SCR_USER1 = 0, RCMAP_ROLL = 1.0, RCMAP_PITCH = 2.0, RCMAP_YAW = 4.0 },
  pwm = {}, roll_us = 1500, pitch_us = 1480, yaw_us = 1510, breaches = 0,
}

local uint32 = {}
uint32.__index = uint32
uint32.__sub = function(a, b) return setmetatable({ v = (a.v - b.v) % 4294967296 }, uint32) end
function uint32:tofloat() return self.v + 0.0 end
function millis() return setmetatable({ v = stub.now % 4294967296 }, uint32) end

gcs = {}
function gcs:send_text(level, text) stub.texts[#stub.texts + 1] = text end

rc = {}
function rc:get_pwm(channel)
  assert(math.type(channel) == 'integer', 'channel must be an integer')
  return ({ stub.roll_us, stub.pitch_us, 1700, stub.yaw_us })[channel]
end
fence = {}
function fence:get_breaches() return stub.breaches end
function rc:has_valid_input() return stub.radio end
function rc:find_channel_for_option(option)
  if option ~= stub.option then return nil end
  local channel = {}
  function channel:get_aux_switch_pos() return stub.switch end
  return channel
end

arming = {}
function arming:is_armed() return stub.armed end
vehicle = {}
function vehicle:get_mode() return stub.mode end

ahrs = {}
function ahrs:get_roll() return stub.roll end -- the older name: the newer one is missing on purpose
function ahrs:get_pitch_rad() return stub.pitch end
function ahrs:airspeed_estimate() return stub.eas end
function ahrs:get_EAS2TAS() return stub.eas2tas end
function ahrs:get_relative_position_D_home() return stub.down end
function ahrs:get_accel()
  local vector = {}
  function vector:z() return stub.az end
  return vector
end

param = {}
function param:get(name) return stub.params[name] end

SRV_Channels = {}
function SRV_Channels:get_output_pwm_chan(channel)
  if not stub.channel_outputs then error('attempt to call a nil value') end
  return stub.pwm[channel]
end
function SRV_Channels:get_output_pwm(fn)
  for n = 1, 16 do
    if stub.params['SERVO' .. n .. '_FUNCTION'] == fn then return stub.pwm[n - 1] end
  end
end
function SRV_Channels:set_output_pwm_chan_timeout(channel, pwm, timeout)
  assert(math.type(pwm) == 'integer', 'pwm must be an integer')
  stub.sent[#stub.sent + 1] = { stub.now, channel, pwm, timeout }
end

logger = {}
function logger:write(name, labels, format, ...)
  assert(#name <= 4 and #labels <= 64 and #format == select('#', ...), 'log message')
  if name == 'TBSE' then stub.ended = { ... } else stub.logged[#stub.logged + 1] = { ... } end
end
