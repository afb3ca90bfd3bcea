// The `canopen` package from npm as an independent peer: frames go over standard input and output, one a
// line: identifier and data in hexadecimal. `slave NODE` is a node for our master; `client NODE TASKS` reads
// and writes a node with its SDO client and answers with a line that begins with '='.
'use strict';
const Module = require('module');
const readline = require('readline');

// Its CRC is a native module that is only there where it could be compiled: CRC-16, polynomial 1021h.
function crc(bits, reflect, polynomial, initial, a, b, c, d, data) {
    let value = initial;
    for (const byte of data) {
        value ^= byte << 8;
        for (let k = 0; k < 8; ++k)
            value = ((value & 0x8000) ? (value << 1) ^ polynomial : value << 1) & 0xFFFF;
    }
    return Buffer.from([value >> 8, value & 0xFF]);
}

const load = Module._load;
Module._load = function (name, ...rest) {
    return name === 'node-crc' ? { crc } : load.call(this, name, ...rest);
};

const { Device, DataType } = require('canopen');

function connect(device) {
    device.addListener('message', ({ id, data }) => {
        process.stdout.write(`${id.toString(16)} ${Buffer.from(data).toString('hex')}\n`);
    });
    readline.createInterface({ input: process.stdin }).on('line', (line) => {
        const [id, data] = line.split(' ');
        device.receive({ id: parseInt(id, 16), data: Buffer.from(data || '', 'hex') });
    }).on('close', () => process.exit(0));
}

function variable(eds, index, dataType, value, parameterName) {
    const entry = eds.addEntry(index, { parameterName, dataType, accessType: 'rw' });
    entry.value = value;
    return entry;
}

function slave(number) {
    const device = new Device({ id: number });
    const eds = device.eds;
    eds.addSdoServerParameter(number, 0x580 + number, 0x600 + number);
    eds.setSyncCobId(0x80);
    eds.setHeartbeatProducerTime(50);
    variable(eds, 0x2000, DataType.UNSIGNED32, 0x12345678, 'number');
    variable(eds, 0x2001, DataType.REAL32, 1.5, 'real');
    variable(eds, 0x2002, DataType.INTEGER16, -7, 'signed');
    variable(eds, 0x2003, DataType.VISIBLE_STRING, 'a text that needs several segments', 'text');
    variable(eds, 0x2004, DataType.VISIBLE_STRING, 'Z'.repeat(3000), 'long text');
    const control = variable(eds, 0x6040, DataType.UNSIGNED16, 0, 'control');
    const target = variable(eds, 0x607A, DataType.INTEGER32, 0, 'target');
    const offset = variable(eds, 0x60B2, DataType.INTEGER16, 0, 'offset');
    const velocity = variable(eds, 0x606C, DataType.INTEGER32, 77, 'velocity');
    const torque = variable(eds, 0x6077, DataType.INTEGER16, -3, 'torque');
    eds.addReceivePdo({ cobId: 0x200 + number, transmissionType: 1, dataObjects: [control, target, offset] });
    eds.addTransmitPdo({ cobId: 0x180 + number, transmissionType: 1, dataObjects: [control, target, offset] });
    eds.addTransmitPdo({ cobId: 0x280 + number, transmissionType: 1, dataObjects: [torque, velocity] });
    connect(device);
    device.start();
}

async function client(number, tasks) {
    const device = new Device({ id: 0x7E });
    device.eds.addSdoClientParameter(number, 0x600 + number, 0x580 + number);
    connect(device);
    device.start();
    device.nmt.startNode();
    for (const task of tasks) {
        const args = { serverId: number, index: task.index, subIndex: task.sub, timeout: 5000,
            blockTransfer: Boolean(task.block) };
        try {
            if (task.write !== undefined) {
                await device.sdo.download({ ...args, data: Buffer.from(task.write, 'hex') });
                process.stdout.write('=done\n');
            }
            else {
                const data = await device.sdo.upload(args);
                process.stdout.write(`=${Buffer.from(data).toString('hex')}\n`);
            }
        }
        catch (error) {
            process.stdout.write(`=error ${error.code !== undefined ? error.code.toString(16) : ''} ${error.message}\n`);
        }
    }
}

const [role, number, tasks] = process.argv.slice(2);
if (role === 'slave')
    slave(parseInt(number));
else
    client(parseInt(number), JSON.parse(tasks));
